"""Drives a headless Chromium over its debugging pipe, with nothing but Python's own library.

    with Browser() as browser:
        page = browser.open("http://127.0.0.1:8000/", 512, 512)
        page.run("document.title")
"""

import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time


class BrowserError(Exception):
    pass


class Browser:
    def __init__(self, *options):
        program = shutil.which("chromium")
        if not program:
            raise BrowserError("no chromium; scripts/install-packages --for test installs it")
        self.profile = tempfile.mkdtemp(prefix="slf-browser-")
        to_browser, self.write_end = os.pipe()
        self.read_end, from_browser = os.pipe()

        def pipes():  # the browser reads from 3 and writes to 4
            a, b = os.dup(to_browser), os.dup(from_browser)
            os.dup2(a, 3)
            os.dup2(b, 4)

        self.process = subprocess.Popen(
            [program, "--headless=new", "--no-sandbox", "--remote-debugging-pipe",
             # Mesa draws without a graphics card, sooner than the browser's own SwiftShader.
             "--use-gl=angle", "--use-angle=gl-egl", "--ignore-gpu-blocklist",
             "--disable-gpu-sandbox",
             "--hide-scrollbars", "--mute-audio", "--no-first-run", "--disable-extensions",
             "--disable-background-networking", "--disable-component-update", "--disable-sync",
             "--disable-dev-shm-usage", "--force-color-profile=srgb",
             *options, f"--user-data-dir={self.profile}", "about:blank"],
            preexec_fn=pipes, close_fds=False, stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(to_browser)
        os.close(from_browser)
        self.buffer = b""
        self.count = 0
        self.events = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        os.close(self.write_end)
        os.close(self.read_end)
        shutil.rmtree(self.profile, ignore_errors=True)

    def processes(self):
        """The numbers of all its processes."""
        parents = {}
        for name in filter(str.isdigit, os.listdir("/proc")):
            try:
                with open(f"/proc/{name}/stat") as file:
                    parents[int(name)] = int(file.read().rsplit(")", 1)[1].split()[1])
            except OSError:
                pass  # it has ended
        found = [self.process.pid]
        for process in found:
            found += [child for child, parent in parents.items() if parent == process]
        return found

    def read(self, deadline):
        while b"\0" not in self.buffer:
            left = deadline - time.monotonic()
            if left <= 0 or not select.select([self.read_end], [], [], left)[0]:
                raise BrowserError("the browser does not answer")
            piece = os.read(self.read_end, 1 << 20)
            if not piece:
                raise BrowserError("the browser ended")
            self.buffer += piece
        message, self.buffer = self.buffer.split(b"\0", 1)
        return json.loads(message)

    def call(self, method, session=None, timeout=60, **parameters):
        self.count += 1
        message = {"id": self.count, "method": method, "params": parameters}
        if session:
            message["sessionId"] = session
        os.write(self.write_end, json.dumps(message).encode() + b"\0")
        deadline = time.monotonic() + timeout
        while True:
            answer = self.read(deadline)
            if answer.get("id") != self.count:
                self.events.append(answer)
                continue
            if "error" in answer:
                raise BrowserError(f"{method}: {answer['error'].get('message')}")
            return answer["result"]

    def targets(self, kind="page"):
        """The addresses of pages, or of frames (kind iframe) of other sites, by their targets."""
        return {found["targetId"]: found["url"]
                for found in self.call("Target.getTargets")["targetInfos"]
                if found["type"] == kind}

    def attach(self, target):
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        return Page(self, session, target)

    def open(self, url, width, height, scale=1, dark=True, calm=False):
        """A page in a window of its own, so that none hides another. `calm`: cameras jump."""
        page = self.attach(self.call("Target.createTarget", url="about:blank",
                                     newWindow=True)["targetId"])
        page.call("Page.enable")
        page.call("Runtime.enable")
        page.call("Log.enable")
        page.call("Emulation.setDeviceMetricsOverride", width=width, height=height,
                  deviceScaleFactor=scale, mobile=False)
        page.call("Emulation.setEmulatedMedia", features=[
            {"name": "prefers-color-scheme", "value": "dark" if dark else "light"},
            *([{"name": "prefers-reduced-motion", "value": "reduce"}] if calm else [])])
        page.call("Page.navigate", url=url)
        return page


class Page:
    def __init__(self, browser, session, target):
        self.browser, self.session, self.target = browser, session, target

    def call(self, method, timeout=60, **parameters):
        return self.browser.call(method, self.session, timeout, **parameters)

    def run(self, expression, timeout=60):
        """The value of an expression, which may be a promise."""
        answer = self.call("Runtime.evaluate", timeout, expression=expression, awaitPromise=True,
                           returnByValue=True)
        if "exceptionDetails" in answer:
            details = answer["exceptionDetails"]
            raise BrowserError(details.get("exception", {}).get("description", details["text"]))
        return answer["result"].get("value")

    def wait(self, expression, timeout=120):
        """Waits until an expression is true."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            try:
                if self.run(expression):
                    return
            except BrowserError as error:
                if "does not answer" in str(error) or "ended" in str(error):
                    raise
            time.sleep(0.05)
        raise BrowserError(f"not true after {timeout} s: {expression}; {self.complaints()}")

    def complaints(self):
        """What the page wrote to its console."""
        texts = []
        for event in self.browser.events:
            parameters = event.get("params", {})
            if event.get("method") == "Runtime.exceptionThrown":
                details = parameters["exceptionDetails"]
                texts.append(details.get("exception", {}).get("description", details["text"]))
            elif event.get("method") == "Log.entryAdded":
                texts.append(parameters["entry"]["text"])
            elif event.get("method") == "Runtime.consoleAPICalled":
                texts.append(" ".join(str(a.get("value")) for a in parameters["args"]))
        return texts

    def settle(self, timeout=240):
        """Waits until the page shows all it can of the view."""
        self.wait("['settled', 'failed'].includes(globalThis.slf?.state)", timeout)
        if self.run("slf.state") == "failed":
            raise BrowserError(self.run("slf.message"))
        # One more frame, for what came last.
        self.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def canvas(self, path):
        """Writes the canvas as PNG."""
        text = self.run("slf.root.getElementById('picture').toDataURL('image/png')")
        with open(path, "wb") as file:
            file.write(base64.b64decode(text.split(",", 1)[1]))

    def screenshot(self, path):
        with open(path, "wb") as file:
            file.write(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))

    def close(self):
        self.browser.call("Target.closeTarget", targetId=self.target)
