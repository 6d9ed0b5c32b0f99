"""A headless Chromium for the tests of pages: open, ask, move the mouse, take pictures, print.

Browser uses the Chrome DevTools Protocol over two pipes (--remote-debugging-pipe: one JSON object
per message, with a zero byte behind each), so it needs no port and no library. The browser has no
sandbox, because root cannot use it. So open only pages of the tests.
"""
import base64
import json
import os
import select
import shutil
import subprocess
import time

from twinlock_test import Failure, Skip, expect, scratch

NAMES = ("chromium", "chromium-browser", "google-chrome")
FLAGS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--hide-scrollbars", "--no-first-run",
         "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-extensions",
         "--force-color-profile=srgb", "--remote-debugging-pipe")
PATIENCE = 60  # s for one answer, on a busy machine


def find_browser():
    """Path of a browser. Without one the test is skipped, or fails if CI=true."""
    for name in NAMES:
        if shutil.which(name):
            return shutil.which(name)
    why = "there is no Chromium: script/bootstrap --all installs it"
    expect(os.environ.get("CI") != "true", f"{why} (CI=true does not allow to skip it)")
    raise Skip(why)


class Browser:
    """One browser with one page, for a `with` statement."""

    def __init__(self):
        program = find_browser()
        theirs_in, self.to = os.pipe()
        self.from_, theirs_out = os.pipe()

        def pipes():  # the browser reads from 3 and writes to 4
            spare = os.dup2(theirs_in, 50), os.dup2(theirs_out, 51)
            os.dup2(spare[0], 3)
            os.dup2(spare[1], 4)

        self.process = subprocess.Popen(
            [program, *FLAGS, f"--user-data-dir={scratch()}", "about:blank"], preexec_fn=pipes, close_fds=False,
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(theirs_in)
        os.close(theirs_out)
        self.number = 0
        self.buffer = b""
        self.events = []
        self.session = None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        os.close(self.to)
        os.close(self.from_)
        self.process.kill()
        self.process.wait()

    def _message(self, until):
        """The next message, or None at the time `until`."""
        while b"\0" not in self.buffer:
            ready, _, _ = select.select([self.from_], [], [], max(0, until - time.monotonic()))
            if not ready:
                return None
            piece = os.read(self.from_, 1 << 20)
            if not piece:
                raise Failure("the browser has ended")
            self.buffer += piece
        message, _, self.buffer = self.buffer.partition(b"\0")
        return json.loads(message)

    def call(self, method, **parameters):
        """Runs one command and returns its result. Other messages go to `events`."""
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.to, json.dumps(message).encode() + b"\0")
        until = time.monotonic() + PATIENCE
        while (answer := self._message(until)) is not None:
            if answer.get("id") == self.number:
                expect("error" not in answer, f"{method}: {answer.get('error')}")
                return answer["result"]
            self.events.append(answer)
        raise Failure(f"the browser does not answer {method}")

    def ask(self, expression):
        """The value of a JavaScript expression on the page."""
        result = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        expect("exceptionDetails" not in result, f"{expression}: {result.get('exceptionDetails')}")
        return result["result"].get("value")

    def open(self, path, width=1280, height=900, dark=False):
        """Opens a file and clears `events`."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.call("Emulation.setEmulatedMedia",
                  features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}])
        self.events.clear()
        self.call("Page.navigate", url=path.as_uri())
        until = time.monotonic() + PATIENCE
        while self.ask("document.readyState") != "complete":
            expect(time.monotonic() < until, f"{path}: is not loaded after {PATIENCE} s")
            time.sleep(0.05)

    def happened(self, *methods):
        """The parameters of the events of these kinds since the page was opened."""
        self.ask("1")
        return [event["params"] for event in self.events if event.get("method") in methods]

    def move(self, x, y, buttons=0, kind="mouseMoved", clicks=0):
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, buttons=buttons, clickCount=clicks,
                  button="left" if kind != "mouseMoved" or buttons else "none")

    def drag(self, start, end):
        self.move(*start)
        self.move(*start, buttons=1, kind="mousePressed", clicks=1)
        for part in (0.3, 0.6, 1.0):
            self.move(*(a + (b - a) * part for a, b in zip(start, end)), buttons=1)
        self.move(*end, kind="mouseReleased", clicks=1)

    def double_click(self, x, y):
        for clicks in (1, 2):
            self.move(x, y, buttons=1, kind="mousePressed", clicks=clicks)
            self.move(x, y, kind="mouseReleased", clicks=clicks)

    def picture(self, path, whole=True):
        """Writes a PNG of the whole page, or of the window."""
        shot = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(shot["data"]))

    def print(self, path):
        """Writes a PDF on A4, with the page's print style."""
        printed = self.call("Page.printToPDF", printBackground=False, preferCSSPageSize=False, paperWidth=8.27,
                            paperHeight=11.69)
        path.write_bytes(base64.b64decode(printed["data"]))
