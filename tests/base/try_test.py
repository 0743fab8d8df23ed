#!/usr/bin/env python3
"""SLF_TRY is a whole statement, initializer or operand of return (base/try.h says why).

Nothing else may stand before it than the beginning of a statement, `return`, or a single `=`, and
nothing after it than the end of the statement. First, the check finds what it must in samples.
"""

import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
FOLDERS = ["base", "storage", "codec", "field", "view", "include", "cli", "python", "tests",
           "benchmarks", "examples"]
# Comments, literals, raw literals and lines of the preprocessor hold no code.
NO_CODE = re.compile(r'//[^\n]*|/\*.*?\*/|R"(\w*)\(.*?\)\1"|"(?:\\.|[^"\\\n])*"'
                     r"|(?<![0-9a-fA-F])'(?:\\.|[^'\\\n])+'|^[ \t]*#(?:[^\n]*\\\n)*[^\n]*",
                     re.DOTALL | re.MULTILINE)
USE = re.compile(r"\bSLF_TRY\s*\(")
CONTROL = re.compile(r"(?:else\b|if\s*(?:constexpr\s*)?(?=\()|(?:for|while)\s*(?=\()"
                     r"|(?:case\b[^?()]*?|default)(?<!:):(?!:))\s*")
# Nothing, `return`, or what is declared or assigned to: names, with templates and indices.
TARGET = re.compile(r"(?:return|[\w*\[][\w:<>,&*\s.\[\]-]*(?<![<>*&-])=)?")

WRONG = [
    "f(SLF_TRY(g()));",
    "auto a = f(b(), SLF_TRY(g()));",
    "auto a = std::make_shared<T>(T{b, SLF_TRY(g())});",
    "T a(SLF_TRY(g()));",
    "T a{SLF_TRY(g())};",
    "T a = {SLF_TRY(g()), 1};",
    "T a{.b = SLF_TRY(g()), .c = 1};",
    "T a = {1, .b = SLF_TRY(g())};",
    "auto a = SLF_TRY(f(SLF_TRY(g())));",
    "auto a = SLF_TRY(\n    f(b(),\n      SLF_TRY(g())));",
    "auto a = b() + SLF_TRY(g());",
    "auto a = b ? c() : SLF_TRY(g());",
    "auto a = b ? SLF_TRY(g()) : c;",
    "b() && SLF_TRY(g());",
    "b() << SLF_TRY(g());",
    "a += SLF_TRY(g());",
    "auto a = *SLF_TRY(g());",
    "auto a = SLF_TRY(g()).size();",
    "SLF_TRY(g()).run();",
    "return {SLF_TRY(g())};",
    "return T(SLF_TRY(g()));",
    "return a + SLF_TRY(g());",
    "if (!SLF_TRY(g())) return;",
    "if (const auto a = SLF_TRY(g()); a) return;",
    "for (const auto& a : SLF_TRY(g())) f(a);",
    "while (SLF_TRY(g())) {}",
    "switch (SLF_TRY(g())) {}",
    "a[SLF_TRY(g())] = 1;",
    "const auto f = [a = SLF_TRY(g())] {};",
    "T() : a(b()), c(SLF_TRY(g())) {}",
    "T(b()).c = SLF_TRY(g());",
    "f(b(), c = SLF_TRY(g()));",
    "auto a = b(), c = d() + SLF_TRY(g());",
    "co_return SLF_TRY(g());",
]
RIGHT = [
    "SLF_TRY(g());",
    "{ SLF_TRY(g(a, (b), \")\", ')')); }",
    "const auto a = SLF_TRY(g());",
    "const std::vector<std::pair<int, T*>>& a = SLF_TRY(\n    g());",
    "auto [a, b] = SLF_TRY(g());",
    "a = SLF_TRY(g());",
    "a.b->c[k] = SLF_TRY(g());",
    "return SLF_TRY(g());",
    "if (a(b) == 1) SLF_TRY(g());",
    "if (a) return SLF_TRY(g());",
    "if (a) b = SLF_TRY(g()); else SLF_TRY(h());",
    "for (const T& a : b) SLF_TRY(g(a));",
    "for (int k = 0; k < n; ++k) a[k] = SLF_TRY(g(k));",
    "case T::a: SLF_TRY(g());",
    "auto a = SLF_TRY(f([&]() -> Result<void> { SLF_TRY(g()); return {}; }));",
    "// f(SLF_TRY(g()));",
    "#define A(x) \\\n  f(SLF_TRY(x))\nint b;",
]


def code_of(text):
    """The text with blanks for what is no code, at the same places."""
    return NO_CODE.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), text)


def closing(code, opening):
    """The place of the bracket that closes the one at `opening`."""
    depth = 0
    for place in range(opening, len(code)):
        depth += (code[place] in "([{") - (code[place] in ")]}")
        if depth == 0:
            return place
    return len(code)


def beginning(code, place):
    """Where the statement begins that `place` is in; None inside round or square brackets."""
    depth = 0
    while place > 0:
        place -= 1
        if depth == 0 and code[place] in ";{}":
            return place + 1
        depth += (code[place] in ")]}") - (code[place] in "([{")
        if depth < 0:
            return None
    return 0


def is_whole(code, use):
    """Whether that use of SLF_TRY is all of its statement, but for a target or `return`."""
    end = closing(code, use.end() - 1) + 1
    begin = beginning(code, use.start())
    if begin is None or not code[end:].lstrip().startswith(";"):
        return False
    before = code[begin:use.start()].strip()
    while control := CONTROL.match(before):
        before = before[control.end():]
        if before.startswith("("):
            before = before[closing(before, 0) + 1:].lstrip()
    return TARGET.fullmatch(before) is not None


def wrong_lines(text):
    code = code_of(text)
    return [1 + code.count("\n", 0, use.start())
            for use in USE.finditer(code) if not is_whole(code, use)]


def main():
    failed = False
    for sample in WRONG + ["void f() {\n  " + sample for sample in WRONG]:
        if not wrong_lines(sample):
            print(f"this check does not find: {sample}")
            failed = True
    for sample in RIGHT + ["int g() { return 1'000; }\n" + sample for sample in RIGHT]:
        if wrong_lines(sample):
            print(f"this check refuses: {sample}")
            failed = True
    uses = 0
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix not in (".cc", ".h", ".cpp"):
                continue
            text = path.read_text()
            uses += len(USE.findall(text))
            for line in wrong_lines(text):
                print(f"{path.relative_to(ROOT)}:{line}: SLF_TRY is not a whole statement or "
                      "initializer: give its value a name first")
                failed = True
    if uses < 100:
        print(f"only {uses} uses were found: the folders have moved")
        failed = True
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
