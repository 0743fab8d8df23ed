#!/usr/bin/env python3
"""doc/commands.md names every environment variable that slf, its scripts or its tests read."""

import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
FOLDERS = ["base", "benchmarks", "cli", "cmake", "codec", "examples", "field", "scripts", "storage",
           "tests", ".ci"]
READS = [
    re.compile(r'getenv\("(\w+)"\)'),                  # C and C++
    re.compile(r'number_in\("(\w+)"\)'),
    re.compile(r'environ(?:\.get\(|\[)"(\w+)"(?!\] *\+?=)'),  # Python
    re.compile(r"\$\{?(SLF_\w+)"),                     # shell
    re.compile(r"\$ENV\{(\w+)\}"),                     # CMake
]
# Variables of CMake, whose scripts spell them as a shell would.
CMAKE = re.compile(r"option\((\w+)|set\((\w+)|-D(\w+)[=:]?")


def main():
    found, defined = {}, set()
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*")):
            if not path.is_file() or path.suffix in (".pyc", ".session") or "corpus" in path.parts:
                continue
            try:
                text = path.read_text()
            except UnicodeDecodeError:
                continue
            is_cmake = path.name == "CMakeLists.txt" or path.suffix in (".cmake", ".in")
            if is_cmake:
                defined |= {name for names in CMAKE.findall(text) for name in names if name}
            for pattern in READS[-1:] if is_cmake else READS:
                for name in pattern.findall(text):
                    found.setdefault(name, path.relative_to(ROOT))
    page = (ROOT / "doc/commands.md").read_text()
    section = page.split("## Environment", 1)[-1].split("\n## ", 1)[0]
    named = set(re.findall(r"`(\w+)(?:=\w+)?`", section))
    failed = False
    for name, path in sorted(found.items()):
        if name not in named and name not in defined:
            print(f"{path} reads {name}, which doc/commands.md, Environment, does not name")
            failed = True
    return 1 if failed or not found else 0


if __name__ == "__main__":
    sys.exit(main())
