"""Headless Chromium through its DevTools protocol: opens a page, runs JavaScript in it, clicks, takes pictures."""

import base64
import itertools
import json
import re
import shutil
import subprocess
import tempfile
import threading
import time
import urllib.request
from pathlib import Path
from typing import Any

from websockets.sync.client import connect

FLAGS = (
    "--headless", "--no-sandbox", "--no-first-run", "--hide-scrollbars", "--disable-quic", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)  # fmt: skip
"""No requests for updates; rendering by the processor."""
PATIENCE = 120.0
"""Timeout of every wait [s]."""


class Chromium:
    """A browser with one page."""

    def __init__(self, address: str, width: int, height: int) -> None:
        """Open an address in a window of this size [px]; below 500 px the browser emulates a telephone."""
        self._folder = tempfile.mkdtemp()
        command = ["chromium", *FLAGS, f"--user-data-dir={self._folder}", "--remote-debugging-port=0", "about:blank"]
        self._process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        self._count, self.events = itertools.count(1), list[dict[str, Any]]()
        found = None
        for line in self._process.stderr or ():
            found = re.search(r"DevTools listening on ws://([^/]+)/", line)
            if found:
                break
        assert found, "Chromium did not start"
        self._drain = threading.Thread(target=lambda: list(self._process.stderr or ()), daemon=True)
        self._drain.start()
        with urllib.request.urlopen(f"http://{found[1]}/json", timeout=PATIENCE) as answer:
            (page,) = (page for page in json.load(answer) if page["type"] == "page")
        self._socket = connect(page["webSocketDebuggerUrl"], max_size=None, open_timeout=PATIENCE)
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 500
        )
        self.call("Page.navigate", url=address)

    def call(self, method: str, **given: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        number = next(self._count)
        self._socket.send(json.dumps({"id": number, "method": method, "params": given}))
        while True:
            answer = json.loads(self._socket.recv(timeout=PATIENCE))
            if answer.get("id") == number:
                assert "error" not in answer, answer
                return answer["result"]
            self.events.append(answer)

    def js(self, code: str) -> Any:
        """Evaluate an expression in the page and return its value."""
        answer = self.call("Runtime.evaluate", expression=code, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def until(self, code: str) -> None:
        """Wait until an expression is true."""
        begin = time.monotonic()
        while not self.js(code):
            assert time.monotonic() - begin < PATIENCE, f"never: {code}"
            time.sleep(0.1)

    def picture(self, path: Path) -> None:
        """Write a screenshot as PNG."""
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))

    def click(self, text: str) -> float:
        """Click the button with this text; return the time of the click by `time.perf_counter` [s]."""
        x, y = self.js(
            f"(() => {{ const b = [...document.querySelectorAll('button')].find(b => b.innerText.trim() === {text!r});"
            "b.scrollIntoView({block: 'center'}); const r = b.getBoundingClientRect();"
            "return [r.x + r.width / 2, r.y + r.height / 2]; })()"
        )
        begin = 0.0
        for kind in ("mousePressed", "mouseReleased"):
            begin = time.perf_counter()
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
        return begin

    def hit(self, key: str) -> None:
        """Press and release a letter's key."""
        for kind in ("keyDown", "keyUp"):
            self.call(
                "Input.dispatchKeyEvent", type=kind, key=key.lower(), code=f"Key{key}", windowsVirtualKeyCode=ord(key)
            )

    @property
    def asked(self) -> set[str]:
        """Addresses which the page has requested, except for `data:` and `blob:`."""
        requests = (event for event in self.events if event["method"] == "Network.requestWillBeSent")
        addresses = {event["params"]["request"]["url"] for event in requests}
        return {address for address in addresses if not address.startswith(("data:", "blob:"))}

    def close(self) -> None:
        """Stop the browser; a second call does nothing."""
        if self._process.returncode is not None:
            return
        self._socket.close()
        self._process.terminate()
        self._process.wait()
        self._drain.join()
        if self._process.stderr:
            self._process.stderr.close()
        shutil.rmtree(self._folder, ignore_errors=True)
