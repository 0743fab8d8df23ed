"""Kinds of web hosts: what the page and slf make of a field there.

    hosts_test.py SLF WORK_FOLDER [PAGE_FOLDER]

Prints a table. The page's part is its module source.js, in a headless Chromium: the bytes that it
reads must be those of the file. Exits with 77, which CTest takes for skipped, without a browser.
PAGE_FOLDER may be the page of another version.
"""

import base64
import json
import os
import random
import shutil
import subprocess
import sys
import unittest

sys.dont_write_bytecode = True

from browser import Browser
from host import Host
from nginx import Nginx

SLF, WORK = sys.argv[1:3]
PAGE = (sys.argv[3:] or [os.path.join(os.path.dirname(__file__), "../../page/web")])[0]

CORS = {"Access-Control-Allow-Origin": "*"}
EXPOSED = CORS | {"Access-Control-Expose-Headers": "Content-Range, ETag"}

# What a host is and does; what the page says, and what slf says: None if it reads the field. The
# page's ratio is that of the bytes to those that it needs.
LACKS = "does not serve parts of files"
KINDS = {
    # The page and its field on the same host:
    "many ranges": (Host, {}, None, None),
    "one range": (Host, {"ranges": "one"}, None, None),
    "one range, no bytes=-N": (Host, {"ranges": "one", "suffix": "no"}, None, None),
    "one range, 416 for bytes=-N": (Host, {"ranges": "one", "suffix": "416"}, None, None),
    "one range, -N as 0-N": (Host, {"ranges": "one", "suffix": "as 0-N"}, None, None),
    "many ranges, no bytes=-N": (Host, {"suffix": "no"}, None, None),
    "no ranges": (Host, {"ranges": "none"}, None, None),
    "no ranges, no length": (Host, {"ranges": "none", "hides_length": True}, None, None),
    "no ranges, 64 MiB and more": (Host, {"ranges": "none", "field": "large.slf"}, LACKS, LACKS),
    "the same, no length": (Host, {"ranges": "none", "field": "large.slf", "hides_length": True},
                            LACKS, LACKS),
    "404": (Host, {"status": 404}, "404", "404"),
    "404 without end": (Host, {"status": 404, "endless": True}, "404", "404"),
    "403": (Host, {"status": 403}, "403", "403"),
    "503": (Host, {"status": 503}, "503", "503"),
    "HTTP/1.1 of nginx": (Nginx, {"http2": False}, None, False),
    "HTTP/2, one range": (Nginx, {}, None, False),
    "HTTP/2, many ranges": (Nginx, {"max_ranges": 200}, None, False),
    # The field on another host than the page:
    "other, CORS": (Host, {"headers": EXPOSED, "preflight": True}, None, None),
    "other, CORS without preflight": (Host, {"headers": EXPOSED}, None, None),
    "other, CORS that hides headers": (Host, {"headers": CORS}, None, None),
    "other, hides headers, no ranges": (Host, {"headers": CORS, "ranges": "none"}, None, None),
    "other, without CORS": (Host, {}, "Access-Control-Allow-Origin", None),
    "other, HTTP/2": (Nginx, {"headers": CORS}, None, False),
    "other, HTTP/2, timing": (Nginx, {"headers": CORS | {"Timing-Allow-Origin": "*"}}, None, False),
}
RANGES = 150


def path(name):
    return os.path.join(WORK, name)


class HostsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        shutil.rmtree(WORK, ignore_errors=True)
        os.makedirs(WORK)
        for name in ["source.js", "text.js", "style.css"]:
            shutil.copy(os.path.join(PAGE, name), path(name))
        with open(path("empty.html"), "w") as file:
            file.write("<!doctype html>")
        subprocess.run([SLF, "-q", "build", "scene:balls", "-o", path("field.slf"), "--entry", "4",
                        "--exit", "8", "--levels", "1"], check=True, capture_output=True)
        with open(path("large.slf"), "wb") as file:
            file.truncate((64 << 20) + 1)
        with open(path("field.slf"), "rb") as file:
            cls.content = file.read()
        # As the tiles of a view lie in a file: small, in groups, and these far apart.
        draw = random.Random(1)
        cls.ranges, at = [], 16384
        while at + 20000 < len(cls.content) and len(cls.ranges) < RANGES:
            size = draw.randrange(50, 600)
            cls.ranges.append([at, at + size])
            at += size + (draw.randrange(400) if draw.random() < 0.7 else draw.randrange(4000))
        cls.browser = Browser()
        print(f"\n{'host':32} | the page: result, requests, bytes read to needed | slf")

    @classmethod
    def tearDownClass(cls):
        cls.browser.__exit__()

    def read(self, page, url):
        """What source.js makes of a field: its message, the bytes of the ranges and statistics."""
        return page.run(f"""(async () => {{
          const {{HttpSource}} = await import('/source.js');
          const source = new HttpSource({json.dumps(url)});
          let error, parts = [];
          try {{
            await source.open();
            const before = source.bytes;
            const text = (bytes) => btoa(String.fromCharCode(...bytes));
            parts = (await Promise.all(source.readAll({json.dumps(self.ranges)}))).map(text);
            var read = source.bytes - before;
          }} catch (failure) {{
            error = failure.message;
          }}
          return {{error, parts, read, size: source.size, requests: source.requests}};
        }})()""", 60)

    def test_each_kind(self):
        payload = sum(end - begin for begin, end in self.ranges)
        with Host(WORK) as home:
            for kind, (make, quirks, page_says, slf_says) in KINDS.items():
                if make is Nginx and not Nginx.available():
                    print(f"{kind:32} | skipped: no nginx or openssl")
                    continue
                quirks = dict(quirks)
                field = quirks.pop("field", "field.slf")
                with self.subTest(host=kind), make(WORK, **quirks) as host:
                    page = self.browser.open("about:blank", 64, 64)
                    page.call("Security.setIgnoreCertificateErrors", ignore=True)
                    where = home if kind.startswith("other") else host
                    page.call("Page.navigate", url=where.url + "/empty.html")
                    page.wait("document.readyState === 'complete' && location.pathname !== 'blank'")
                    try:
                        found = self.read(page, f"{host.url}/{field}")
                    finally:
                        page.close()
                    ratio = (found.get("read") or 0) / payload
                    result = found.get("error") or f"read, {found['requests']}, {ratio:.2f}"
                    client, said = "", None
                    if slf_says is not False:
                        run = subprocess.run([SLF, "info", f"{host.url}/{field}"], text=True,
                                             capture_output=True, timeout=60)
                        said = run.stderr.strip() if run.returncode else None
                        client = said or "read"
                    print(f"{kind:32} | {result} | {client}", flush=True)
                    if page_says is None:
                        self.assertIsNone(found.get("error"))
                        self.assertEqual(found["size"], len(self.content))
                        for (begin, end), part in zip(self.ranges, found["parts"], strict=True):
                            self.assertEqual(base64.b64decode(part), self.content[begin:end])
                        self.assertLessEqual(found["requests"], 40)
                        self.assertLessEqual(ratio, 2.3)
                    else:
                        self.assertIn(page_says, found.get("error") or "")
                    if slf_says:
                        self.assertIn(slf_says, said or "")
                    elif slf_says is None:
                        self.assertIsNone(said)


if __name__ == "__main__":
    if not shutil.which("chromium"):
        print("skipped: no chromium")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1], verbosity=2)
