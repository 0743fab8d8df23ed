"""The outcome of a part of the report: claims, sections of the page, and numbers."""

import math
from dataclasses import dataclass, field

CONFIRMED, PARTLY, REFUTED, NOT_RUN = "confirmed", "partly", "not confirmed", "not measured"


@dataclass
class Claim:
    """A claim from the paper or from us, and whether the measurement confirms it."""

    source: str  # "paper, section 3", or "slf"
    text: str
    measured: str
    verdict: str
    command: str = ""  # reproduces the measurement; empty: the command of the whole part


@dataclass
class Part:
    """One experiment. The part fills it in step by step, so results before a failure are kept.
    `html` goes into the page, `numbers` into the JSON."""

    title: str
    claims: list = field(default_factory=list)
    html: list = field(default_factory=list)
    numbers: dict = field(default_factory=dict)
    left_out: list = field(default_factory=list)  # sentences: what could not be done, and why
    failed: bool = False  # this and the following are set by the caller of the part
    seconds: float = 0
    commands: list = field(default_factory=list)

    def add(self, *pieces):
        self.html.extend(pieces)

    def claim(self, source, text, measured, verdict, command=""):
        if isinstance(verdict, bool):
            verdict = CONFIRMED if verdict else REFUTED
        self.claims.append(Claim(source, text, measured, verdict, command))


def mean(values):
    values = list(values)
    return sum(values) / len(values) if values else math.nan


def geometric_mean(values):
    return math.exp(mean(math.log(v) for v in values))


def human_bytes(count):
    for unit in ("B", "KiB", "MiB", "GiB", "TiB"):
        if count < 1024 or unit == "TiB":
            return f"{count:.0f} {unit}" if unit == "B" else f"{count:.3g} {unit}"
        count /= 1024


def human_count(count):
    for limit, unit in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if count >= limit:
            return f"{count / limit:.3g} {unit}"
    return f"{count:g}"
