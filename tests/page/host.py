"""A host of static files that counts what it answers, and may be as slow as a network.

    with Host(FOLDER, ranges="one", rate=1.25e6, delay=0.04) as host:
        …open host.url…
        print(len(host.requests("field.slf")), host.bytes("field.slf"))
"""

import functools
import http.server
import os
import re
import threading
import time

PIECE = 8 << 10  # bytes sent at once: connections share the rate fairly


class Link:
    """What all connections share: so many bytes a second (None: any), and a delay in seconds."""

    def __init__(self, rate, delay):
        self.rate, self.delay = rate, delay
        self.lock, self.free = threading.Lock(), 0.0

    def send(self, file, data):
        for at in range(0, len(data), PIECE):
            piece = data[at:at + PIECE]
            if self.rate:
                with self.lock:
                    self.free = max(self.free, time.monotonic()) + len(piece) / self.rate
                    wait = self.free - time.monotonic()
                time.sleep(max(0.0, wait))
            file.write(piece)


class Handler(http.server.SimpleHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    extensions_map = {".html": "text/html", ".js": "text/javascript", ".css": "text/css",
                      ".wasm": "application/wasm", "": "application/octet-stream"}

    def __init__(self, host, *arguments):
        self.host, self.fresh = host, True
        super().__init__(*arguments, directory=host.folder)

    def log_message(self, *_):
        pass

    def ranges(self, size):
        """The ranges that are asked for and served, [begin, end); None: the whole file."""
        header = self.headers.get("Range", "")
        if header.startswith("bytes=-") and self.host.suffix != "yes":
            return [(0, min(int(header[7:]) + 1, size))] if self.host.suffix == "as 0-N" else None
        form = r"bytes=(\d+-\d+|-\d+)(,\d+-\d+)*"
        if self.host.ranges == "none" or not re.fullmatch(form, header):
            return None
        asked = header[6:].split(",")
        if len(asked) > 1 and self.host.ranges == "one":
            return None
        found = []
        for text in asked:
            first, last = text.split("-")
            begin = int(first) if first else max(0, size - int(last))
            end = min(int(last) + 1, size) if first else size
            found.append((begin, end))
        return found

    def end_headers(self):
        for name, value in self.host.headers.items():
            self.send_header(name, value)
        super().end_headers()

    def do_OPTIONS(self):
        """What browsers ask before they send a header Range to another host."""
        self.send_response(204 if self.host.preflight else 405)
        if self.host.preflight:
            self.send_header("Access-Control-Allow-Headers", "Range")
        self.end_headers()

    def answer_error(self, status):
        self.send_response(status)
        self.send_header("Connection", "close")
        self.end_headers()
        self.close_connection = True
        try:
            self.wfile.write(b"no")
            while self.host.endless:
                self.wfile.write(bytes(PIECE))
        except OSError:
            pass

    def do_HEAD(self):
        self.do_GET()

    def do_GET(self):
        # A new connection takes another round trip.
        time.sleep(self.host.link.delay * (2 if self.fresh else 1))
        self.fresh = False
        name = self.translate_path(self.path)
        if os.path.isdir(name):
            name = os.path.join(name, "index.html")
        is_field = name.endswith(".slf")
        if not os.path.isfile(name) or (is_field and self.host.status):
            return self.answer_error(self.host.status or 404)
        if self.host.suffix == "416" and self.headers.get("Range", "").startswith("bytes=-"):
            return self.answer_error(416)
        size = os.path.getsize(name)
        kind = self.guess_type(name)
        with open(name, "rb") as file:
            def read(begin, end):
                file.seek(begin)
                return file.read(end - begin)

            ranges = self.ranges(size) if self.command == "GET" else None
            if ranges is None:
                status, body = 200, None
            elif len(ranges) == 1:
                status, body = 206, read(*ranges[0])
            else:
                status = 206
                body = b"".join(
                    f"\r\n--slf-part\r\nContent-Type: {kind}\r\n"
                    f"Content-Range: bytes {a}-{b - 1}/{size}\r\n\r\n".encode() + read(a, b)
                    for a, b in ranges) + b"\r\n--slf-part--\r\n"
                kind = "multipart/byteranges; boundary=slf-part"
            self.send_response(status)
            self.send_header("Content-Type", kind)
            if is_field and status == 200 and self.host.hides_length:
                self.send_header("Connection", "close")
                self.close_connection = True
            else:
                self.send_header("Content-Length", str(size if body is None else len(body)))
            self.send_header("ETag", f'"{size}-{os.stat(name).st_mtime_ns}"')
            if ranges is not None and len(ranges) == 1:
                self.send_header("Content-Range", f"bytes {ranges[0][0]}-{ranges[0][1] - 1}/{size}")
            self.end_headers()
            if self.command == "HEAD":
                return
            sent = 0
            try:
                for data in iter(lambda: file.read(PIECE), b"") if body is None else [body]:
                    self.host.link.send(self.wfile, data)
                    sent += len(data)
            except OSError:  # the page is closed, or does not want the whole file
                self.close_connection = True
            self.host.log.append((os.path.basename(name), status, sent))


class Quiet(http.server.ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, *_):
        pass  # a page that is closed drops its connections


class Host:
    """Serves a folder. For its field:
    ranges: how many a request may ask for, "many", "one" or "none";
    suffix: how it reads bytes=-N, "yes", "no" (as the whole file), "as 0-N" or "416" (an error);
    status: of all its answers, None for good ones; `endless` errors never end;
    hides_length: of whole files.
    Pages of other hosts: `headers` are sent with all answers; `preflight`: allows the header Range.
    """

    def __init__(self, folder, ranges="many", rate=None, delay=0.0, suffix="yes", status=None,
                 endless=False, hides_length=False, headers=None, preflight=False,
                 handler=Handler):
        self.folder, self.ranges, self.link = folder, ranges, Link(rate, delay)
        self.suffix, self.status, self.endless = suffix, status, endless
        self.hides_length, self.headers, self.preflight = hides_length, headers or {}, preflight
        self.log = []  # (file, status, bytes) of each answer
        self.server = Quiet(("127.0.0.1", 0), functools.partial(handler, self))
        self.thread = threading.Thread(target=self.server.serve_forever, daemon=True)
        self.url = f"http://127.0.0.1:{self.server.server_port}"

    def answers(self, name):
        return [entry for entry in self.log if entry[0] == name]

    def bytes(self, name):
        return sum(entry[2] for entry in self.answers(name))

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.server.shutdown()
        self.server.server_close()
