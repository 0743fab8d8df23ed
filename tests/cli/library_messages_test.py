#!/usr/bin/env python3
"""No message of the libraries names an option of the command line: other programs use them, too."""

import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
LIBRARIES = ["base", "storage", "codec", "field", "view", "include"]
# Texts with an option, but for options of other programs, and what a browser shows of the server.
NAMES_OPTION = re.compile(r'"(?:[^"\\]|\\.)*(?<![\w-])--[a-z](?:[^"\\]|\\.)*"')
OTHERS = re.compile("gdcmconv --raw|slf view --bind")


def main():
    failed = False
    for library in LIBRARIES:
        for path in sorted((ROOT / library).rglob("*")):
            if path.suffix not in (".cc", ".h"):
                continue
            for number, line in enumerate(path.read_text().splitlines(), 1):
                if NAMES_OPTION.search(OTHERS.sub("", line)):
                    print(f"{path.relative_to(ROOT)}:{number}: names an option: {line.strip()}")
                    failed = True
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
