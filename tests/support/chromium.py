"""A headless Chromium driven over its own protocol: enough to load a page, click and measure."""

from __future__ import annotations

import asyncio
import json
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.support.pixels import open_pixels

#: Debian calls it chromium, others chromium-browser or google-chrome.
BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
#: When to give up waiting for what never comes [s]: no machine is that slow.
PATIENCE = 300.0


class Page:
    """One page of a browser process of its own; use as an async context manager."""

    def __init__(self, folder: Path, width: int, height: int) -> None:
        self.folder, self.width, self.height = folder, width, height
        self.errors: list[str] = []
        self.requests: list[str] = []
        self._number = 0

    async def __aenter__(self) -> Page:
        from tornado.websocket import websocket_connect

        assert BROWSER is not None
        self._process = subprocess.Popen(
            [
                BROWSER,
                "--headless=new",
                "--no-sandbox",
                "--use-angle=swiftshader",
                "--enable-unsafe-swiftshader",
                "--remote-debugging-port=0",
                f"--user-data-dir={self.folder}",
                "about:blank",
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        port_file = self.folder / "DevToolsActivePort"
        end = time.monotonic() + PATIENCE
        while not (port_file.exists() and port_file.read_text().strip()):
            assert time.monotonic() < end, "the browser did not start"
            assert self._process.poll() is None, "the browser ended at once"
            await asyncio.sleep(0.1)
        port = port_file.read_text().split()[0]
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list") as answer:
            target = next(t for t in json.load(answer) if t["type"] == "page")
        self._socket = await websocket_connect(
            target["webSocketDebuggerUrl"], max_message_size=2**27
        )
        for domain in ("Page", "Runtime", "Log", "Network"):
            await self.call(f"{domain}.enable")
        await self.call(
            "Emulation.setDeviceMetricsOverride",
            width=self.width,
            height=self.height,
            deviceScaleFactor=1,
            mobile=self.width < 600,
        )
        return self

    async def __aexit__(self, *_: object) -> None:
        self._socket.close()
        self._process.terminate()
        self._process.wait(PATIENCE)

    async def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and wait for its answer; notes errors of the page on the way."""
        self._number += 1
        number = self._number
        await self._socket.write_message(
            json.dumps({"id": number, "method": method, "params": parameters})
        )
        while True:
            message = await asyncio.wait_for(self._socket.read_message(), PATIENCE)
            data = json.loads(message)
            self._note(data)
            if data.get("id") == number:
                assert "error" not in data, data
                result: dict[str, Any] = data["result"]
                return result

    def _note(self, data: dict[str, Any]) -> None:
        method, what = data.get("method"), data.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(what["exceptionDetails"])[:500])
        elif method == "Runtime.consoleAPICalled" and what["type"] in ("error", "assert"):
            self.errors.append(json.dumps(what["args"])[:500])
        elif method == "Log.entryAdded" and what["entry"]["level"] == "error":
            self.errors.append(what["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(what["request"]["url"][:100])

    async def open(self, place: Path | str) -> None:
        """Load a file or an address and wait until it is there."""
        url = place if isinstance(place, str) else place.resolve().as_uri()
        await self.call("Page.navigate", url=url)
        there = f"location.href.startsWith({json.dumps(url)})"
        await self.wait(f"{there} && document.body && document.readyState === 'complete'")

    async def evaluate(self, expression: str) -> Any:
        """Value of a JavaScript expression."""
        answer = await self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    async def wait(self, condition: str) -> None:
        """Wait until a JavaScript condition holds."""
        end = time.monotonic() + PATIENCE
        while not await self.evaluate(f"Boolean({condition})"):
            assert time.monotonic() < end, f"never became true: {condition}"
            await asyncio.sleep(0.2)

    async def screenshot(self, *, whole: bool = False) -> bytes:
        """PNG of the window, or of the whole page."""
        import base64

        answer = await self.call("Page.captureScreenshot", captureBeyondViewport=whole)
        return base64.b64decode(answer["data"])

    async def pixels(self, hold: Callable[[np.ndarray], bool]) -> np.ndarray:
        """RGB (height, width, 3) of the window when a condition on them holds."""
        end = time.monotonic() + PATIENCE
        while not hold(pixels := open_pixels(await self.screenshot())):
            assert time.monotonic() < end, "the window was never drawn as expected"
            await asyncio.sleep(0.2)
        return pixels
