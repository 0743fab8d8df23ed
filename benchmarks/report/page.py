"""The report as files: one self-contained HTML page, its numbers as JSON, a table as Markdown."""

import base64
import html
import io
import json
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from .outcome import CONFIRMED, NOT_RUN, PARTLY, REFUTED

_STYLE = (Path(__file__).parent / "style.css").read_text()
_SCRIPT = (Path(__file__).parent / "turn.js").read_text()
_MARKS = {CONFIRMED: "yes", PARTLY: "partly", REFUTED: "no", NOT_RUN: "unknown"}


# ---- pieces of a part ----------------------------------------------------------------------


@dataclass
class Cell:
    """A picture with its caption; without a path, its place stays empty."""

    path: object = None
    label: str = ""
    note: str = ""


def escape(text):
    return html.escape(str(text))


def text(words):
    return f"<p>{escape(words)}</p>"


def heading(words):
    return f"<h3>{escape(words)}</h3>"


def picture_data(path, quality=90):
    """A picture as a data URI. JPEG is good enough for looking at the report."""
    buffer = io.BytesIO()
    Image.open(path).convert("RGB").save(buffer, "JPEG", quality=quality, subsampling=0)
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode()


def grid(rows):
    """Pictures side by side, rows of Cells."""
    columns = max(len(row) for row in rows)
    cells = "".join(_figure(cell) for row in rows for cell in row)
    return f'<div class="grid" style="--columns:{columns}">{cells}</div>'


def _figure(cell):
    image = f'<img src="{picture_data(cell.path)}" loading="lazy">' if cell.path else ""
    note = f"<small>{escape(cell.note)}</small>" if cell.note else ""
    return f"<figure>{image}<figcaption>{escape(cell.label)} {note}</figcaption></figure>"


def turning(title, strips):
    """A slider that turns pictures around. `strips` are (label, [paths]), all equally long."""
    shown = "".join(
        f'<figure><img data-frames="{escape(json.dumps([picture_data(p, 80) for p in paths]))}">'
        f"<figcaption>{escape(label)}</figcaption></figure>"
        for label, paths in strips
    )
    last = len(strips[0][1]) - 1
    return (
        f'<div class="turning"><h4>{escape(title)}</h4><div class="strips">{shown}</div>'
        f'<input type="range" min="0" max="{last}" value="0" aria-label="turn"></div>'
    )


def plot(svg, caption=""):
    """A drawing by plots.py."""
    words = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f'<figure class="plot">{svg}{words}</figure>'


def table(head, rows, note=""):
    """A table. The first column holds names, the others numbers."""
    line = lambda tag, cells: "".join(f"<{tag}>{escape(c)}</{tag}>" for c in cells)  # noqa: E731
    body = "".join(f"<tr>{line('td', row)}</tr>" for row in rows)
    below = f'<p class="note">{escape(note)}</p>' if note else ""
    return (
        f'<div class="scroll"><table><thead><tr>{line("th", head)}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>{below}"
    )


def folded(words, inside):
    return f"<details><summary>{escape(words)}</summary>{inside}</details>"


# ---- the page ------------------------------------------------------------------------------


def claims_table(parts):
    rows = []
    for name, part in parts:
        for claim in part.claims:
            command = escape(claim.command).replace(" --", "<br>--", 1)
            rows.append(
                f'<tr><td><span class="mark {_MARKS[claim.verdict]}">{claim.verdict}</span></td>'
                f'<td>{escape(claim.text)}<small class="source">{escape(claim.source)}</small></td>'
                f'<td>{escape(claim.measured)}</td><td><a href="#{name}"><code>'
                f"{command}</code></a></td></tr>"
            )
    return (
        '<div class="scroll"><table class="claims"><thead><tr><th></th><th>claim</th>'
        "<th>measured</th><th>shown by</th></tr></thead><tbody>"
        + "".join(rows)
        + "</tbody></table></div>"
    )


def _section(name, part):
    left = "".join(f"<li>{escape(words)}</li>" for words in part.left_out)
    left = f'<ul class="left-out">{left}</ul>' if left else ""
    commands = escape("\n".join(part.commands))
    return (
        f'<section id="{name}"><h2>{escape(part.title)}</h2>{"".join(part.html)}{left}'
        f"<details><summary>{len(part.commands)} commands, {part.seconds:.0f} s</summary>"
        f"<pre>{commands}</pre></details></section>"
    )


def write_html(path, parts, machine, subtitle):
    sections = "".join(_section(name, part) for name, part in parts)
    links = " · ".join(f'<a href="#{n}">{escape(p.title)}</a>' for n, p in parts)
    facts = "; ".join(f"{key} {value}" for key, value in machine.items())
    path.write_text(
        f'<!doctype html><html lang="en"><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>Sphere light fields: the experiments</title><style>{_STYLE}</style>"
        f"<main><h1>Sphere light fields: the experiments</h1><p class=lead>{escape(subtitle)}</p>"
        f"<nav>{links}</nav>{claims_table(parts)}{sections}"
        f"<footer>{escape(facts)}</footer></main><script>{_SCRIPT}</script></html>\n"
    )


def write_json(path, parts, machine):
    path.write_text(
        json.dumps(
            {
                "machine": machine,
                "parts": {
                    name: {
                        "title": part.title,
                        "seconds": round(part.seconds, 1),
                        "claims": [vars(claim) for claim in part.claims],
                        "numbers": part.numbers,
                        "left_out": part.left_out,
                        "commands": part.commands,
                    }
                    for name, part in parts
                },
            },
            indent=1,
        )
        + "\n"
    )


def write_markdown(path, parts, machine, subtitle):
    lines = ["# Sphere light fields: the experiments", "", subtitle, ""]
    lines += ["| verdict | claim | of | measured | shown by |", "|---|---|---|---|---|"]
    for _, part in parts:
        for claim in part.claims:
            cells = [claim.verdict, claim.text, claim.source, claim.measured, f"`{claim.command}`"]
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    left = [f"- {part.title}: {words}" for _, part in parts for words in part.left_out]
    if left:
        lines += ["", "Left out:", "", *left]
    lines += ["", "; ".join(f"{key} {value}" for key, value in machine.items())]
    path.write_text("\n".join(lines) + "\n")
