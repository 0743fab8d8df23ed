#!/usr/bin/env python3
"""Checks the types of the package, with those of its extension module as the module states them.

  PYTHONPATH=build/release/python python/tests/check_types.py     needs mypy, which has stubgen

The stub is made anew each time: nobody writes it. pybind11's words for arguments are narrower, or
no words of typing: they become what conversions take.
"""

import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

import slf

HEAD = """import os
from typing import Any, List, Optional, Sequence, Tuple, Union
import numpy
"""


def typed(line):
    """One declaration."""
    while re.search(r"List\[([^\[\]]|\[[^\[\]]*\])*\[\d+\]\]", line):  # std::array
        line = re.sub(r"List\[((?:[^\[\]]|\[[^\[\]]*\])*)\[\d+\]\]", r"Sequence[\1]", line)
    line = re.sub(r"ndarray(\[[\w.]*\])?", "ndarray[Any, Any]", line)
    line = re.sub(r"\bobject\b", "Any", line)
    line = re.sub(r"(\*+\w+)(?=[,)])", r"\1: Any", line)
    line = re.sub(r"\b(tuple|list)\b(?=[,:)])", lambda m: m[0].title() + (
        "[Any, ...]" if m[0] == "tuple" else "[Any]"), line)
    found = re.fullmatch(r"(\s*def \w+\()(.*)(\) -> .*)", line)
    if not found:
        return line
    head, arguments, result = found.groups()
    arguments = re.sub(r"\bstr\b", "Union[str, os.PathLike[str]]", arguments)
    arguments = arguments.replace("List[", "Sequence[")
    # Of a pointer, which may be null, the module states only what it points to.
    arguments = re.sub(r"(?<=: )(Field|StateScenes)(?=,|$)", r"Optional[\1]", arguments)
    return head + arguments + result


def main():
    package = pathlib.Path(slf.__file__).parent
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["stubgen", "-q", "-m", "slf._slf", "-o", folder], check=True)
        stub = pathlib.Path(folder, "slf/_slf.pyi")
        lines = [line for line in stub.read_text().splitlines()
                 if not re.match("from typing import|import numpy", line)]
        stub.write_text(HEAD + "\n".join(map(typed, lines)) + "\n")
        for file in package.iterdir():
            if file.suffix == ".py" or file.name == "py.typed":
                shutil.copy(file, stub.parent)
        sys.exit(subprocess.run(
            [sys.executable, "-m", "mypy", "--cache-dir=/dev/null",
             "--enable-incomplete-feature=Unpack",  # which is complete since mypy 1.4
             "slf"], cwd=folder).returncode)


if __name__ == "__main__":
    main()
