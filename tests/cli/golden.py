#!/usr/bin/env python3
"""Golden sessions: what `slf` prints and how it ends, to the letter.

  golden.py --slf build/release/cli/slf [--update] SESSION...

A session (tests/cli/golden/*.session) is a script with its expected output:

  # a comment
  %normalize REGEX => REPLACEMENT    what may differ between machines or runs, from here on
  $ COMMAND                          a line of sh; `slf` is the program, the folder is empty at first
  | TEXT                             a line of stdout, in this order: stdout, stderr, exit code
  ! TEXT                             a line of stderr
  = N                                the exit code, where it is not 0 (-N: ended by signal N)

A last line without a line feed ends in a backslash. $DATA is tests/data. --update writes what the
commands do now into the session; read the difference before it is committed.
"""

import argparse
import difflib
import os
import pathlib
import re
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent


def lines_of(output, mark):
    """Output as marked lines of a session."""
    lines = [f"{mark} {line}".rstrip(" ") for line in output.split("\n")]
    if output.endswith("\n"):
        return lines[:-1]
    if output:
        return lines[:-1] + [lines[-1] + "\\"]
    return []


def run(command, folder, environment):
    done = subprocess.run(
        ["sh", "-c", command], cwd=folder, env=environment, stdin=subprocess.DEVNULL,
        capture_output=True, timeout=300, check=False)
    out, err = (text.decode("utf-8", "backslashreplace") for text in (done.stdout, done.stderr))
    return out, err, done.returncode


def play(session, slf):
    """The session with the output that its commands have now."""
    played, rules = [], []
    with tempfile.TemporaryDirectory(prefix="slf-golden-") as folder:
        tools = pathlib.Path(folder, "bin")
        tools.mkdir()
        (tools / "slf").symlink_to(slf)
        place = pathlib.Path(folder, "work")
        place.mkdir()
        environment = {
            "PATH": f"{tools}:/usr/bin:/bin", "HOME": str(place), "TMPDIR": folder,
            "LC_ALL": "C.UTF-8", "DATA": str(HERE.parent / "data"),
        }
        # What the sanitizers need to know.
        environment |= {k: v for k, v in os.environ.items() if k.endswith("SAN_OPTIONS")}
        for line in session.splitlines():
            if line[:2] in ("| ", "! ", "= ") or line in ("|", "!"):
                continue
            played.append(line)
            if line.startswith("%normalize "):
                pattern, replacement = line.removeprefix("%normalize ").split(" => ", 1)
                rules.append((re.compile(pattern), replacement))
            if not line.startswith("$ "):
                continue
            out, err, code = run(line[2:], place, environment)
            for pattern, replacement in [(re.compile(re.escape(environment["DATA"])), "$DATA")] + rules:
                out, err = pattern.sub(replacement, out), pattern.sub(replacement, err)
            played += lines_of(out, "|") + lines_of(err, "!")
            if code != 0:
                played.append(f"= {code}")
    return "\n".join(played) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--slf", required=True, type=pathlib.Path)
    parser.add_argument("--update", action="store_true")
    parser.add_argument("sessions", nargs="+", type=pathlib.Path)
    arguments = parser.parse_args()
    failed = False
    for path in arguments.sessions:
        expected = path.read_text()
        played = play(expected, arguments.slf.resolve())
        if played == expected:
            continue
        if arguments.update:
            path.write_text(played)
            print(f"{path}: updated")
            continue
        failed = True
        sys.stdout.writelines(difflib.unified_diff(
            expected.splitlines(True), played.splitlines(True), f"{path}, expected", "found"))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
