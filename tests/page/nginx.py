"""nginx over HTTP/2, with a certificate of its own.

    with Nginx(FOLDER) as host:
        …open host.url, after page.call("Security.setIgnoreCertificateErrors", ignore=True)…
        print(host.bytes("field.slf"))
"""

import os
import shutil
import socket
import subprocess
import tempfile
import time

CONFIGURATION = """
daemon off; master_process off; pid {work}/pid; error_log {work}/error.log;
events {{ worker_connections 512; }}
http {{
  types {{ text/html html; text/javascript js; text/css css; }}
  default_type application/octet-stream;
  log_format answers "$uri $status $body_bytes_sent $server_protocol";
  access_log {work}/access.log answers;
  client_body_temp_path {work}/b; proxy_temp_path {work}/p; fastcgi_temp_path {work}/f;
  uwsgi_temp_path {work}/u; scgi_temp_path {work}/s;
  server {{
    listen 127.0.0.1:{port} ssl{http2};
    ssl_certificate {work}/certificate; ssl_certificate_key {work}/key;
    root {folder}; max_ranges {max_ranges};
    {headers}
  }}
}}
"""


class Nginx:
    """Serves a folder, with at most `max_ranges` ranges in a request."""

    def __init__(self, folder, max_ranges=1, http2=True, headers=None):
        self.work = tempfile.mkdtemp(prefix="slf-nginx-")
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt",
                        "ec_paramgen_curve:P-256", "-nodes", "-subj", "/CN=localhost", "-days",
                        "2", "-keyout", self.path("key"), "-out", self.path("certificate")],
                       check=True, capture_output=True)
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        with open(self.path("conf"), "w") as file:
            file.write(CONFIGURATION.format(
                work=self.work, folder=os.path.abspath(folder), port=port, max_ranges=max_ranges,
                http2=" http2" if http2 else "",
                headers="".join(f'add_header {name} "{value}" always;'
                                for name, value in (headers or {}).items())))
        self.url = f"https://127.0.0.1:{port}"
        self.process = subprocess.Popen([program(), "-p", self.work, "-c", self.path("conf"), "-e",
                                         self.path("error.log")])
        self.await_port(port)

    @staticmethod
    def available():
        return program() is not None and shutil.which("openssl") is not None

    def await_port(self, port):
        deadline = time.monotonic() + 20
        while self.process.poll() is None and time.monotonic() < deadline:
            with socket.socket() as peer:
                if peer.connect_ex(("127.0.0.1", port)) == 0:
                    return
            time.sleep(0.02)
        with open(self.path("error.log")) as file:
            raise RuntimeError("nginx does not start: " + file.read())

    def path(self, name):
        return os.path.join(self.work, name)

    def answers(self, name):
        """(status, bytes, protocol) of each answer with a file."""
        with open(self.path("access.log")) as file:
            lines = [line.split() for line in file]
        return [(int(status), int(size), protocol) for uri, status, size, protocol in lines
                if os.path.basename(uri) == name]

    def bytes(self, name):
        return sum(size for _, size, _ in self.answers(name))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(20)
        shutil.rmtree(self.work, ignore_errors=True)


def program():
    return shutil.which("nginx") or shutil.which("nginx", path="/usr/sbin")
