#!/usr/bin/env python3
"""Every public function that returns a Result returns exceptions, such as bad_alloc, as errors, too.

Its definition calls guarded() (base/guarded.h), is a function-try-block that ends with
error_of_exception(), or is one statement that returns what another public function returns. Not
what WebAssembly also runs, where there are no exceptions.
"""

import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
ROOMS = ("base", "storage", "codec", "field", "source", "image")
NAME = r"(?:operator\W+|\w+)"
DECLARED = re.compile(r"^ *(?:\[\[nodiscard\]\] )?(?:static |friend |virtual )*Result<[^;{]*?>\s+"
                      rf"({NAME})\(", re.M)


def declared():
    """(header, class or "", name) of the public functions that are not defined in their header."""
    for header in sorted((ROOT / "include/slf").glob("*.h")):
        text = re.sub(r"//.*", "", header.read_text())
        for found in DECLARED.finditer(text):
            at = found.end()
            depth = 1
            while depth:
                depth += {"(": 1, ")": -1}.get(text[at], 0)
                at += 1
            rest = text[at:at + 40].split(";")[0]
            before = text[:found.start()]
            classes = re.findall(r"^(?:class|struct) (\w+)[^;{]*\{|^(\};)", before, re.M)
            inside = classes[-1][0] if classes and not classes[-1][1] else ""
            section = re.findall(r"^ (public|private|protected):", before[before.rfind("\nclass"):],
                                 re.M)
            if "{" in rest or "= 0" in rest or (inside and section and section[-1] != "public"):
                continue
            if "friend" in found[0]:
                inside = ""
            yield header.name, inside, found[1]


def definitions(inside, name):
    """The definitions of these functions: file, line, text."""
    scope = rf"{inside}::" if inside else r"(?<!::)"
    begin = re.compile(rf"^Result<[^;{{}}]*?>\s+{scope}{name}\(", re.M)
    for room in ROOMS:
        for source in sorted((ROOT / room).rglob("*.cc")):
            text = source.read_text()
            for found in begin.finditer(text):
                if text.rfind("\nnamespace {", 0, found.start()) > text.rfind("\n}  // namespace\n", 0,
                                                                         found.start()):
                    continue
                end = text.find("\n}\n", found.start())
                one_line = text.find("}\n", found.start(), text.find("\n", found.start()) + 1)
                end = one_line + 1 if one_line > 0 else end + 2
                yield (source.relative_to(ROOT), text[:found.start()].count("\n") + 1,
                       text[found.start():end])


def main():
    functions = sorted(set(declared()))
    names = {name for _, _, name in functions}
    portable = (ROOT / "page/wasm/sources.cmake").read_text()
    wrong, seen = [], 0
    for header, inside, name in functions:
        found = list(definitions(inside, name))
        if not found:
            wrong.append(f"{header}: {inside}::{name}: no definition")
        for source, line, text in found:
            seen += 1
            body = text[text.index("{"):] if "{" in text else ""
            passed_on = re.fullmatch(r"\{\s*return (?:\w+(?:\.|->|::))*(\w+)\([^;]*;\s*\}", body)
            if not (str(source) in portable or "guarded(" in text or "error_of_exception(" in text or
                    (passed_on and passed_on[1] in names)):
                wrong.append(f"{source}:{line}: {inside}{'::' if inside else ''}{name}")
    print("\n".join(wrong))
    print(seen, "definitions of", len(functions), "functions")
    return len(wrong) > 0 or seen < 80


if __name__ == "__main__":
    sys.exit(main())
