#!/usr/bin/env python3
"""What `slf ... --json` prints is what schemas/COMMAND.json says, for every command that has it; and
these are what the descriptions of reports make.

  schemas_test.py --slf build/release/cli/slf --tables build/release/cli/slf_tables [--update]
"""

import argparse
import json
import pathlib
import re
import subprocess
import sys
import tempfile

import jsonschema

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "page"))
sys.dont_write_bytecode = True

import host

DATA = HERE.parent / "data"
SCHEMAS = HERE.parent.parent / "schemas"

# Commands that make what the others read, then some for each schema. A field is F.slf or G.slf, a
# picture F.png. `diff` and `verify` may end with the codes 7 and 3.
PREPARE = [
    "build scene:balls -o F.slf --entry 2 --exit 4 --levels 1",
    "repack F.slf -o G.slf --codec jpeg:60 --subfields 0-40",
    "build scene:balls --states s.json -o S.slf --entry 2 --exit 4 --levels 1",
    "build scene:balls --states z.json -o Z.slf --entry 2 --exit 4 --levels 1",
    "build scene:balls -o part-1.slf --entry 2 --exit 4 --levels 1 --shard 1/2",
    "build scene:balls -o part-2.slf --entry 2 --exit 4 --levels 1 --shard 2/2",
    "cameras --sphere 0,0,0,1 --count 12 --size 32 -o c.json",
    "raycast scene:balls --cameras c.json -o balls",
    "build w.raw --dims 16x16x16 --reveal --lighting direct -o V.slf --entry 2 --exit 4 --levels 0",
    "render F.slf -o F.png --size 32",
    "render G.slf -o G.png --size 32",
]
CASES = {
    "info": ["info F.slf --json", "info S.slf --json", "info S.slf --state globe --json", "info G.slf --json", f"info {DATA}/golden/example.slf --json",
             "info part-2.slf --json", "info v.raw --dims 2x2x2 --json",
             "info v.raw --dims 2x2x2 --labels --json",
             f"info {DATA}/dicom --json", f"info {DATA}/dicom --series 3 --json",
             "info pictures:balls --json", "info V.slf --json"],
    "merge": ["merge part-1.slf part-2.slf -o M.slf --json"],
    "render": ["render F.slf -o x.png -f --size 32 --json"],
    "pick": ["pick F.slf --size 32 16,16 --json", "pick F.slf --size 32 0,0 --json"],
    "measure": ["measure F.slf G.slf --views 2 --size 32 --json"],
    "evaluate": ["evaluate F.slf --volume scene:balls --views 2 --size 32 --json",
                 "evaluate F.slf --pictures balls --json"],
    "compare": ["compare F.png F.png --json", "compare F.png G.png --json"],
    "build": ["build scene:fog --quality draft --dry-run --json"],
    "repack": ["repack F.slf -o H.slf -f --json", "repack F.slf -o H.slf -f --levels 0 --json",
               "repack F.slf --codec predictive:50 --dry-run --json",
               "repack S.slf --split-states -o {state}.slf --json"],
    "verify": ["verify F.slf --json", f"verify {DATA}/golden/flipped_tile.slf --json",
               f"verify {DATA}/golden/incomplete.slf --json", "verify W.slf --json"],
    "transfer": ["transfer --json --list", "transfer ct-bone --json"],
    "ls": ["ls F.slf --json", "ls S.slf --state again --json", "ls G.slf --json --missing --level 1 --subfields 3",
           f"ls {DATA}/golden/incomplete.slf --json"],
    "diff": ["diff F.slf F.slf --json", "diff F.slf G.slf --json",
             f"diff F.slf {DATA}/golden/example.slf --json", "diff S.slf Z.slf --json"],
    "export": ["export F.slf -o F.html -f --json", "export F.slf -o site -f --levels 0 --json"],
    "view": [],  # below: it ends when it is told to
    "play": ["play F.slf --orbit 0,20,3 --seconds 0.2 --fps 10 --size 32 --json"],
}

STATES = {"states": [{"name": "balls"}, {"name": "globe", "input": "scene:globe"},
                     {"name": "again"}]}

OTHER_STATES = {"states": [{"name": "balls"}, {"name": "globe"},
                           {"name": "again", "input": "scene:globe"}]}

# Commands that take long with large fields.
LONG = [
    "build scene:balls -o P.slf --entry 2 --exit 4 --levels 1",
    "build scene:balls -o part.slf --entry 2 --exit 4 --levels 1 --shard 2/3",
    "merge part-1.slf part-2.slf -o Q.slf",
    "repack F.slf -o R.slf --codec predictive:50",
    "repack F.slf --codec predictive:50 --dry-run",
    "verify F.slf",
    "diff F.slf G.slf",
    "measure F.slf --views 2 --size 32",
    "evaluate F.slf --volume scene:balls --views 2 --size 32",
    "play F.slf --orbit 0,20,3 --seconds 0.2 --fps 10 --size 32",
    "raycast scene:balls -o r.png --size 32",
    "export F.slf -o E.html --levels 0",
]

# Texts that are numbers, sizes, or numbers with a unit.
MEASURED = re.compile(r"[0-9.]+(x[0-9.]+)*( ?([kKMGT]i?)?(B|bytes|px|pixels|m?s|mm|dB|%))?")


def texts(document, path="$"):
    """The texts in a JSON document, with their places."""
    if isinstance(document, str):
        yield path, document
    if isinstance(document, (dict, list)):
        pairs = document.items() if isinstance(document, dict) else enumerate(document)
        for key, value in pairs:
            yield from texts(value, f"{path}/{key}")


class Checker:
    def __init__(self, slf, folder):
        self.slf, self.folder = slf, folder
        self.failures = 0

    def run(self, line):
        return subprocess.run([self.slf, *line.split()], cwd=self.folder, text=True,
                              capture_output=True, stdin=subprocess.DEVNULL, check=False)

    def complain(self, text):
        self.failures += 1
        print(text)

    def schema(self, name):
        schema = json.loads((SCHEMAS / f"{name}.json").read_text())
        jsonschema.Draft7Validator.check_schema(schema)
        return jsonschema.Draft7Validator(schema)

    def check(self, validator, line, text):
        try:
            document = json.loads(text)
        except json.JSONDecodeError as error:
            return self.complain(f"slf {line}: is no JSON: {error}\n{text[:500]}")
        for path, value in texts(document):
            names_series = path.rsplit("/", 1)[-1] in ("id", "number", "uid")
            if MEASURED.fullmatch(value) and not names_series:
                self.complain(f"slf {line}: {path} is the text {value!r}, expected a number")
        for error in validator.iter_errors(document):
            detail = jsonschema.exceptions.best_match([error])
            self.complain(f"slf {line}: {detail.json_path}: {detail.message[:500]}")
        return None

    def check_progress(self, line):
        line = f"--progress json:0.0001 {line}"
        done = self.run(line)
        reports = [report for report in done.stderr.splitlines() if report.startswith("{")]
        for report in reports:
            self.check(self.schema("progress"), line, report)
        last = json.loads(reports[-1]) if reports else {}
        if done.returncode not in (0, 7) or not reports or last["done"] != last["total"]:
            self.complain(f"slf {line}: does not report progress to its end\n{done.stderr[-500:]}")

    def has_page(self):
        return self.run("export F.slf -o F.html -f").returncode != 5

    def check_view(self):
        """The server prints its address, then serves until it is stopped."""
        if not self.has_page():
            return
        line = "view F.slf --json"
        with subprocess.Popen([self.slf, "-q", *line.split()], cwd=self.folder, text=True,
                              stdout=subprocess.PIPE) as process:
            text = "".join(iter(process.stdout.readline, "}\n")) + "}"
            process.terminate()
        self.check(self.schema("view"), line, text)

    def check_distant(self, folder):
        """Over HTTP the same is printed, and the traffic."""
        with host.Host(folder) as server:
            probe = self.run(f"info {server.url}/F.slf")
            if probe.returncode == 5:
                return print("not tested over HTTP: slf was built without libcurl")
            for name in ["info", "render", "measure", "evaluate", "repack", "verify", "diff",
                         "play"]:
                near = CASES[name][0]
                far = near.replace("F.slf", f"{server.url}/F.slf")
                text = self.run(far).stdout
                self.check(self.schema(name), far, text)
                if text and json.loads(text).get("http", {}).get("requests", 0) < 3:
                    self.complain(f"slf {far}: does not count its requests")
            near, far = [self.run(f"ls {at}F.slf").stdout for at in ["", server.url + "/"]]
            if near != far:
                self.complain("slf ls lists another field over HTTP")

    def commands_with_json(self):
        """Those whose help has the option."""
        help_text = self.run("--help").stdout
        names = re.findall(r"^  ([a-z]+) ", help_text.split("Subcommands:")[-1], re.M)
        return {name for name in names
                if re.search(r"^  (-\S+, )?--json\b", self.run(f"{name} --help").stdout, re.M)}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--slf", required=True, type=pathlib.Path)
    parser.add_argument("--tables", required=True, type=pathlib.Path)
    parser.add_argument("--update", action="store_true", help="only write schemas/*.json")
    arguments = parser.parse_args()
    for name, schema in json.loads(subprocess.check_output([arguments.tables, "schemas"])).items():
        file = SCHEMAS / f"{name}.json"
        text = json.dumps(schema, indent=2, ensure_ascii=False) + "\n"
        if arguments.update:
            file.write_text(text)
        elif not file.exists() or file.read_text() != text:
            sys.exit(f"{file} is not what is described: schemas_test.py --update writes it")
    if arguments.update:
        return
    with tempfile.TemporaryDirectory(prefix="slf-schemas-") as folder:
        checker = Checker(arguments.slf.resolve(), folder)
        pathlib.Path(folder, "v.raw").write_bytes(bytes(range(8)))
        pathlib.Path(folder, "w.raw").write_bytes(bytes(x ^ y for x in range(64) for y in range(64)))
        pathlib.Path(folder, "s.json").write_text(json.dumps(STATES))
        pathlib.Path(folder, "z.json").write_text(json.dumps(OTHER_STATES))
        checker.schema("recipe").validate(STATES)
        for line in PREPARE:
            done = checker.run(line)
            if done.returncode != 0:
                sys.exit(f"slf {line}: {done.stderr}")
        data = bytearray(pathlib.Path(folder, "V.slf").read_bytes())
        data[data.rfind(b"SLV1") + 100] ^= 1
        pathlib.Path(folder, "W.slf").write_bytes(data)
        found = checker.commands_with_json()
        if found != set(CASES):
            checker.complain(f"commands with --json: {sorted(found)}; tested: {sorted(CASES)}")
        if not checker.has_page():
            print("not tested: export and view; slf was built without the page")
            CASES["export"] = []
            LONG.pop()
        for name, lines in CASES.items():
            validator = checker.schema(name)
            for line in lines:
                checker.check(validator, line, checker.run(line).stdout)
        checker.check_view()
        checker.check_distant(folder)

        for line in LONG:
            checker.check_progress(line)
    sys.exit(1 if checker.failures else 0)


if __name__ == "__main__":
    main()
