"""Runs the experiments and writes the report. Started by scripts/report, which says how."""

import argparse
import importlib
import os
import platform
import subprocess
import sys
import time
import traceback
from pathlib import Path

from . import page
from .bench import Bench, Failed
from .outcome import NOT_RUN, Claim, Part

PARTS = [
    "table1",
    "figure6",
    "figure8",
    "figure9",
    "figure10",
    "prefetch",
    "compression",
    "rates",
    "light",
    "growth",
    "pictures",
]
ROOT = Path(__file__).resolve().parents[2]


def arguments():
    parser = argparse.ArgumentParser(
        prog="scripts/report",
        description="Runs the experiments of the paper and of slf, and writes report.html, "
        "report.json and report.md.",
    )
    parser.add_argument("out", nargs="?", default=ROOT / "out/report", type=Path, help="folder")
    parser.add_argument("--quick", action="store_true", help="smaller: minutes, not hours")
    parser.add_argument("--only", default="", help="parts to run: " + ",".join(PARTS))
    parser.add_argument("--data", default=ROOT / "../shared/data", type=Path, help="volumes")
    parser.add_argument("--keep-fields", action="store_true", help="use them again next time")
    chosen = parser.parse_args()
    chosen.parts = chosen.only.split(",") if chosen.only else PARTS
    for name in chosen.parts:
        if name not in PARTS:
            parser.error(f"no part {name}; there are: {', '.join(PARTS)}")
    return chosen


def run_part(bench, name, quick):
    """Runs a part and returns its outcome. A failure is noted there, and the others go on."""
    bench.part, bench.commands = name, []
    command = f"scripts/report --only {name}" + (" --quick" if quick else "")
    begin = time.monotonic()
    module = importlib.import_module(f".{name}", __package__)
    part = Part(module.TITLE)
    bench.say("begins")
    try:
        module.run(bench, part)
    except Exception as error:  # an incomplete report is better than none
        if not isinstance(error, Failed):
            traceback.print_exc()
        bench.say(f"FAILED: {error}")
        part.left_out.append(f"failed: {error}")
        part.claims.append(Claim("", part.title, f"failed: {error}", NOT_RUN))
        part.failed = True
    part.seconds, part.commands = time.monotonic() - begin, bench.commands
    for claim in part.claims:
        claim.command = claim.command or command
    return part


def machine(quick):
    processor = "?"
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            processor = line.split(":")[1].strip()
            break
    git = ["git", "-C", str(ROOT), "describe", "--always", "--dirty"]
    try:
        commit = subprocess.run(git, capture_output=True, text=True).stdout.strip() or "?"
    except OSError:  # there is no git
        commit = "?"
    return {
        "commit": commit,
        "processor": processor,
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "load before": round(os.getloadavg()[0], 1),
        "mode": "quick" if quick else "full",
    }


def main():
    chosen = arguments()
    facts = machine(chosen.quick)
    chosen.out.mkdir(parents=True, exist_ok=True)
    bench = Bench(ROOT, chosen.out.resolve(), chosen.data, chosen.quick, chosen.keep_fields)
    parts = []
    try:
        for name in chosen.parts:
            parts.append((name, run_part(bench, name, chosen.quick)))
            write(chosen.out, parts, facts, chosen.quick)  # in case a later part aborts
    finally:
        bench.close()
    failed = [name for name, part in parts if part.failed]
    print(f"{chosen.out}/report.html, report.json, report.md: {bench.seconds():.0f} s")
    for name, part in parts:
        for words in part.left_out:
            print(f"  {name}: {words}")
    return 4 if failed else 0


def write(out, parts, facts, quick):
    subtitle = "What the paper claims and what we claim, measured on this machine" + (
        " (quick: smaller fields and fewer views than the full report)." if quick else "."
    )
    page.write_html(out / "report.html", parts, facts, subtitle)
    page.write_json(out / "report.json", parts, facts)
    page.write_markdown(out / "report.md", parts, facts, subtitle)


if __name__ == "__main__":
    sys.exit(main())
