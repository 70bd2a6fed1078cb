"""A real browser that tests drive, with true mouse, keys and touches: Chromium over its DevTools pipe."""

import base64
import json
import os
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from browser import BROWSER, FLAGS

READS, WRITES = 3, 4
"""The descriptors that Chromium takes commands from and answers on."""

KEY_CODES = {
    " ": 32,
    "ArrowLeft": 37,
    "ArrowUp": 38,
    "ArrowRight": 39,
    "ArrowDown": 40,
    "Tab": 9,
    "Enter": 13,
}


class Page:
    """A page in a tab. `said` is what its console said, `asked` the addresses that it requested."""

    def __init__(self, send: Callable[..., Any], events: list[dict[str, Any]]) -> None:
        self._send, self._events = send, events

    @property
    def said(self) -> list[str]:
        names = {"Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded"}
        return [json.dumps(e["params"]) for e in self._events if e["method"] in names]

    @property
    def asked(self) -> list[str]:
        sent = [
            e["params"]["request"]["url"] for e in self._events if e["method"] == "Network.requestWillBeSent"
        ]
        return [url for url in sent if not url.startswith(("file:", "data:", "blob:", "about:"))]

    def begin(self) -> None:
        """Forget what was said and asked, in a large window without touches."""
        self.looks(1280, 900)
        self._events.clear()

    def open(self, path: Path, ready: str = "true") -> None:
        """Load a file and wait until an expression is true in it."""
        self._send("Page.navigate", url=path.as_uri())
        look = f"const look = () => ({ready}) ? done() : setTimeout(look, 10)"
        wait = f"new Promise((done) => {{ {look}; look(); }})"
        while True:
            with suppress(RuntimeError):  # the document before it is gone
                if self("location.href") == path.as_uri():
                    self(wait)
                    return

    def __call__(self, expression: str) -> Any:
        """The value of an expression, awaited. Raises `RuntimeError` for one that fails."""
        found = self._send("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in found:
            raise RuntimeError(json.dumps(found["exceptionDetails"]))
        return found["result"].get("value")

    def looks(self, width: int, height: int, dark: bool = False, touch: bool = False) -> None:
        """The window, the colours that the user prefers, and whether it is touched."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": touch}
        self._send("Emulation.setDeviceMetricsOverride", **size)
        self._send("Emulation.setTouchEmulationEnabled", enabled=touch)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self._send("Emulation.setEmulatedMedia", features=[scheme])

    def middle(self, element: str) -> tuple[float, float]:
        """Where to press an element, which an expression gives; it is scrolled into view."""
        box = self(
            f"(() => {{ const e = {element}; e.scrollIntoView({{block: 'center'}}); "
            "const b = e.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; })()"
        )
        return box[0], box[1]

    def click(self, element: str) -> None:
        x, y = self.middle(element)
        for kind in ("mousePressed", "mouseReleased"):
            self._send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def tap(self, element: str) -> None:
        x, y = self.middle(element)
        self._send("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
        self._send("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def press(self, key: str) -> None:
        code = KEY_CODES.get(key) or ord(key.upper())
        named = {"key": key, "windowsVirtualKeyCode": code}
        typed = {"text": key} if len(key) == 1 else {}
        self._send("Input.dispatchKeyEvent", type="keyDown", **named, **typed)
        self._send("Input.dispatchKeyEvent", type="keyUp", **named)

    def downloads_to(self, folder: Path) -> None:
        """Where what the page saves goes."""
        self._send("Page.setDownloadBehavior", behavior="allow", downloadPath=str(folder))

    def picture(self, path: Path, whole: bool = False) -> None:
        found = self._send("Page.captureScreenshot", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(found["data"]))


@contextmanager
def browser(folder: Path) -> Iterator[Page]:
    """A browser with a new profile in a folder, and one page."""
    assert BROWSER is not None
    commands, answers = os.pipe(), os.pipe()

    flags = (*FLAGS, "--remote-debugging-pipe", f"--user-data-dir={folder}", "about:blank")
    connected = f'exec "$0" "$@" {READS}<&{commands[0]} {WRITES}>&{answers[1]}'
    nothing = subprocess.DEVNULL
    process = subprocess.Popen(
        ["bash", "-c", connected, BROWSER, *flags],
        pass_fds=(commands[0], answers[1]),
        stdin=nothing,
        stdout=nothing,
        stderr=nothing,
    )
    os.close(commands[0])
    os.close(answers[1])
    with open(commands[1], "wb", buffering=0) as out, open(answers[0], "rb") as back:
        try:
            yield _page(out, back)
        finally:
            process.terminate()
            process.wait(20)


def _page(out: Any, back: Any) -> Page:
    events: list[dict[str, Any]] = []
    numbers = iter(range(1, 10**9))
    waiting = bytearray()

    def answer(number: int) -> dict[str, Any]:
        while True:
            while (end := waiting.find(0)) < 0:
                some = os.read(back.fileno(), 2**16)
                assert some, "the browser is gone"
                waiting.extend(some)
            message: dict[str, Any] = json.loads(waiting[:end])
            del waiting[: end + 1]
            if message.get("id") == number:
                assert "error" not in message, message
                return message["result"]
            if "method" in message:
                events.append(message)

    def call(method: str, session: str = "", **given: Any) -> dict[str, Any]:
        number = next(numbers)
        where = {"sessionId": session} if session else {}
        message = json.dumps({"id": number, "method": method, "params": given, **where})
        out.write(message.encode() + b"\0")
        return answer(number)

    target = call("Target.createTarget", url="about:blank")["targetId"]
    session = call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
    for domain in ("Page", "Runtime", "Network", "Log"):
        call(f"{domain}.enable", session)
    return Page(lambda method, **given: call(method, session, **given), events)
