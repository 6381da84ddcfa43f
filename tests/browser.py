"""Headless Chromium over its DevTools protocol: enough to open a page, press keys, look at it and listen to it."""

import json
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
_FLAGS = ("--headless=new", "--disable-gpu", "--hide-scrollbars", "--no-first-run", "--remote-debugging-port=0")
_SECONDS = 60
_KEYS = {"Tab": 9, "Enter": 13, " ": 32, "ArrowLeft": 37, "ArrowUp": 38, "+": 187, "0": 48}


class Page:
    """One page. `events` holds what it reported, by name of the event."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self._last = 0
        self.events: list[dict[str, Any]] = []
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and return its answer, keeping the events that come before it."""
        return self._answer(self._send(method, **parameters))

    def _send(self, method: str, **parameters: Any) -> int:
        self._last += 1
        self._socket.send(json.dumps({"id": self._last, "method": method, "params": parameters}))
        return self._last

    def _answer(self, number: int) -> dict[str, Any]:
        while True:
            message = json.loads(self._socket.recv(timeout=_SECONDS))
            if message.get("id") == number:
                assert "error" not in message, message
                return message["result"]
            if "id" not in message:
                self.events.append(message)

    def open(self, path: Path, width: int = 1200, height: int = 900) -> None:
        """Open a file and wait until it is loaded."""
        self.resize(width, height)
        self.events.clear()
        self.call("Page.navigate", url=path.resolve().as_uri())
        while not any(e["method"] == "Page.loadEventFired" for e in self.events):
            self.events.append(json.loads(self._socket.recv(timeout=_SECONDS)))

    def resize(self, width: int, height: int = 900) -> None:
        """Make the window as large as that."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def value(self, expression: str) -> Any:
        """Return what a JavaScript expression gives, promises awaited."""
        result = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def press(self, key: str) -> None:
        """Press a key as a user does."""
        shown = {"text": key} if len(key) == 1 else {"text": "\r"} if key == "Enter" else {}
        code = {"key": key, "windowsVirtualKeyCode": _KEYS[key]}
        self._send("Input.dispatchKeyEvent", type="keyDown", **code, **shown)
        self._answer(self._send("Input.dispatchKeyEvent", type="keyUp", **code))

    def media(self, scheme: str, kind: str = "") -> None:
        """Prefer a colour scheme, and be a screen that can print, or with `print` look as a print does."""
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.call("Emulation.setEmulatedMedia", media=kind, features=features)

    def complaints(self) -> list[Any]:
        """Return the errors and warnings of console, log and scripts so far."""
        kinds = ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")
        return [e["params"] for e in self.events if e["method"] in kinds]

    def requested(self) -> list[str]:
        """Return the addresses that the page asked for so far."""
        return [e["params"]["request"]["url"] for e in self.events if e["method"] == "Network.requestWillBeSent"]


@contextmanager
def browser() -> Iterator[Page]:
    """Start Chromium with a profile of its own and give its first page; end it afterwards."""
    assert CHROMIUM
    root = ["--no-sandbox"] if os.geteuid() == 0 else []
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [CHROMIUM, *_FLAGS, *root, f"--user-data-dir={profile}", "about:blank"]
        process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
        try:
            assert process.stderr
            found = next(m for line in process.stderr if (m := re.search(r"listening on ((ws://[^/]+)\S+)", line)))
            with connect(found[1], open_timeout=_SECONDS) as whole:
                whole.send(json.dumps({"id": 1, "method": "Target.getTargets"}))
                targets = json.loads(whole.recv(timeout=_SECONDS))["result"]["targetInfos"]
            target = next(t["targetId"] for t in targets if t["type"] == "page")
            address = f"{found[2]}/devtools/page/{target}"
            with connect(address, max_size=None, open_timeout=_SECONDS) as socket:
                yield Page(socket)
        finally:
            process.terminate()
            process.wait(timeout=_SECONDS)
            if process.stderr:
                process.stderr.close()
