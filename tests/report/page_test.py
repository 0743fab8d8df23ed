"""The report's files: nothing from outside is markup, and every number reaches the JSON."""

import html.parser
import json
import tempfile
import unittest
from pathlib import Path

from PIL import Image
from report import page
from report.outcome import Part

HOSTILE = '<script>alert("x")</script> & | pipe'
VOID = {"meta", "img", "br", "input", "link", "hr"}


class Balance(html.parser.HTMLParser):
    """Fails on a closing tag that nothing opened."""

    def __init__(self):
        super().__init__()
        self.open, self.scripts = [], 0

    def handle_starttag(self, tag, _):
        self.scripts += tag == "script"
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        # These may be left open in HTML.
        while self.open and self.open[-1] != tag and self.open[-1] in ("p", "li"):
            self.open.pop()
        assert self.open and self.open[-1] == tag, (tag, self.open)
        self.open.pop()


def hostile_part():
    part = Part("Title " + HOSTILE)
    part.add(
        page.text(HOSTILE),
        page.heading(HOSTILE),
        page.table([HOSTILE, "n"], [[HOSTILE, 3]], HOSTILE),
    )
    part.claim(HOSTILE, HOSTILE, HOSTILE, True, "scripts/report --only " + HOSTILE)
    part.left_out.append(HOSTILE)
    part.commands.append(HOSTILE)
    part.numbers = {"rows": [1, 2.5]}
    return part


class Files(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def test_html_is_balanced_and_escapes_what_it_is_given(self):
        path = self.folder / "report.html"
        page.write_html(path, [("part", hostile_part())], {"cores": 2}, HOSTILE)
        text = path.read_text()
        parser = Balance()
        parser.feed(text)
        self.assertEqual(parser.scripts, 1)  # the page's own
        self.assertNotIn("<script>alert", text)
        self.assertEqual([t for t in parser.open if t not in ("html", "p")], [])

    def test_json_holds_claims_numbers_and_commands(self):
        path = self.folder / "report.json"
        page.write_json(path, [("part", hostile_part())], {"cores": 2})
        part = json.loads(path.read_text())["parts"]["part"]
        self.assertEqual(part["numbers"], {"rows": [1, 2.5]})
        self.assertEqual(part["claims"][0]["verdict"], "confirmed")
        self.assertEqual(part["commands"], [HOSTILE])

    def test_markdown_rows_have_five_cells_whatever_is_in_them(self):
        path = self.folder / "report.md"
        page.write_markdown(path, [("part", hostile_part())], {"cores": 2}, "")
        rows = [line for line in path.read_text().splitlines() if line.startswith("| ")]
        self.assertEqual(len(rows), 2)
        for row in rows:
            self.assertEqual(row.replace("\\|", "").count("|"), 6)

    def test_pictures_are_embedded(self):
        path = self.folder / "a.png"
        Image.new("RGBA", (4, 2), (255, 0, 0, 255)).save(path)
        shown = page.grid([[page.Cell(path, HOSTILE), page.Cell()]])
        self.assertEqual(shown.count("<figure>"), 2)
        self.assertEqual(shown.count("data:image/jpeg;base64,"), 1)
        self.assertNotIn("<script>", shown)


if __name__ == "__main__":
    unittest.main()
