#!/usr/bin/env python3
"""An option of recipes is declared once: in the table, source/recipe/options.cc. Neither the command
line nor Python declares one again.

  names_test.py --tables build/release/cli/slf_tables
"""

import argparse
import json
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[3]

# Options of repack, which are of a field that exists, have names of their own meaning.
OF_FIELDS = {"codec", "depth", "color_type", "levels", "light", "center", "radius", "reveal"}
# Keywords of Python: planes that cut a view, and what of a field is copied.
OF_CALLS = OF_FIELDS | {"clip", "finest_level"}


def declared_again(names):
    for path in sorted((ROOT / "cli").glob("*.cc")):
        for found in re.finditer(r'add_\w+\(\s*\*?\w*,?\s*"--(?:no-)?([\w-]+)"', path.read_text()):
            name = found[1].replace("-", "_")
            if name in names and not (name in OF_FIELDS and path.name != "build.cc"):
                yield f"cli/{path.name}: --{found[1]}"
    for path in [ROOT / "python/slf/_source.py", ROOT / "python/slf/_build.py"]:
        for settings in re.finditer(r"^class \w*Settings\(.*?(?=^\S|\Z)", path.read_text(),
                                    re.MULTILINE | re.DOTALL):
            for found in re.finditer(r"^    (\w+): ", settings[0], re.MULTILINE):
                if found[1] in names:
                    yield f"python/slf/{path.name}: {found[1]}"
    for path in sorted((ROOT / "python/src").glob("*.cc")):
        for keywords in re.findall(r"\bread\(given,(.*?)\);", path.read_text(), re.DOTALL):
            for name in re.findall(r'"(\w+)"', keywords):
                if name in names - OF_CALLS:
                    yield f"python/src/{path.name}: {name}"


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--tables", required=True)
    arguments = parser.parse_args()
    schemas = json.loads(subprocess.check_output([arguments.tables, "schemas"]))
    names = set(schemas["recipe"]["properties"]) - {"states"}
    sys.exit("\n".join(declared_again(names)) or 0)


if __name__ == "__main__":
    main()
