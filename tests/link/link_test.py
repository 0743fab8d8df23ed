"""A program that stores, repacks, draws and serves fields links none of source/.

    link_test.py BUILD PROGRAM
"""
import subprocess
import sys

build, program = sys.argv[1:]
commands = subprocess.run(['ninja', '-C', build, '-t', 'commands', program], check=True,
                          capture_output=True, text=True).stdout.splitlines()
link = [line for line in commands if f'-o {program}' in line]
linked = [word for line in link for word in line.split() if word.endswith(('.a', '.o', '.so'))]
assert any('slf_page' in word for word in linked), link
found = [word for word in linked if 'source' in word or '/cli/' in word]
assert not found, found
# The same test finds them in a program that has them.
command = subprocess.run(['ninja', '-C', build, '-t', 'commands', 'cli/slf'], check=True,
                         capture_output=True, text=True).stdout.splitlines()[-1]
assert 'source' in command
