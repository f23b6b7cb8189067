"""Debian's Firefox ESR, headless, controlled over WebDriver BiDi (w3c.github.io/webdriver-bidi)."""

import contextlib
import itertools
import json
import re
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from websockets.sync.client import connect

from tests.support.patience import HELD, patient
from tests.support.sessions.site import wait_for

FIREFOX = "/usr/bin/firefox-esr"
PREFERENCES = {
    "media.autoplay.default": 0,
    "media.navigator.permission.disabled": True,
    "datareporting.policy.dataSubmissionEnabled": False,
    "app.update.enabled": False,
    "browser.shell.checkDefaultBrowser": False,
    "network.captive-portal-service.enabled": False,
    "network.connectivity-service.enabled": False,
    "browser.aboutConfig.showWarning": False,
}


class Firefox:
    """One browser with one tab."""

    def __init__(self, address: str) -> None:
        self._socket = connect(f"{address}/session", max_size=None)
        self._ids = itertools.count(1)
        self.errors: list[str] = []  # of scripts, since the browser started
        self.command("session.new", capabilities={})
        self.context = self.command("browsingContext.getTree")["contexts"][0]["context"]
        self.command("session.subscribe", events=["log.entryAdded"])

    def command(self, method: str, **params: Any) -> dict[str, Any]:
        number = next(self._ids)
        self._socket.send(json.dumps({"id": number, "method": method, "params": params}))
        while True:
            answer = json.loads(self._socket.recv(timeout=60))
            if answer.get("method") == "log.entryAdded" and answer["params"]["level"] == "error":
                self.errors.append(answer["params"]["text"])
            if answer.get("id") == number:
                assert answer["type"] == "success", answer
                return answer["result"]

    def set_cookie(self, name: str, value: str, domain: str) -> None:
        cookie = {"name": name, "value": {"type": "string", "value": value}}
        self.command("storage.setCookie", cookie={**cookie, "domain": domain, "path": "/"})

    def resize(self, width: int, height: int) -> None:
        size = {"width": width, "height": height}
        self.command("browsingContext.setViewport", context=self.context, viewport=size)

    def goto(self, url: str) -> None:
        self.command("browsingContext.navigate", context=self.context, url=url, wait="complete")

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression, which JSON must be able to express."""
        result = self.command(
            "script.evaluate",
            expression=f"JSON.stringify({expression})",
            target={"context": self.context},
            awaitPromise=True,
        )
        assert result["type"] == "success", result
        return json.loads(result["result"].get("value", "null"))

    def key(self, kind: str, value: str) -> None:
        """Press ("keyDown") or release ("keyUp") a key, by its WebDriver code."""
        self.command(
            "input.performActions",
            context=self.context,
            actions=[{"type": "key", "id": "keys", "actions": [{"type": kind, "value": value}]}],
        )

    def hold(self, value: str, reached: Callable[[], Any], within: float, what: str) -> None:
        """Hold a key until the condition is true; as in `Visitor.hold`, it is pressed again."""
        deadline = time.monotonic() + patient(within)
        while not reached():
            assert time.monotonic() < deadline, f"{what} did not come within {within} s"
            self.key("keyDown", value)
            again = time.monotonic() + HELD
            while not reached() and time.monotonic() < again:
                time.sleep(0.05)
            self.key("keyUp", value)

    def click(self, x: float, y: float) -> None:
        """Click at a point in CSS pixels of the page."""
        press = [
            {"type": "pointerDown", "button": 0},
            {"type": "pause", "duration": 150},
            {"type": "pointerUp", "button": 0},
        ]
        mouse = {
            "type": "pointer",
            "id": "mouse",
            "actions": [{"type": "pointerMove", "x": round(x), "y": round(y)}, *press],
        }
        self.command("input.performActions", context=self.context, actions=[mouse])

    def close(self) -> None:
        with contextlib.suppress(Exception):
            self.command("session.end")
        self._socket.close()


@contextlib.contextmanager
def firefox() -> Iterator[Firefox]:
    with tempfile.TemporaryDirectory(prefix="firefox-", ignore_cleanup_errors=True) as folder:
        profile = Path(folder) / "profile"
        profile.mkdir()
        (profile / "user.js").write_text(
            "".join(f"user_pref({json.dumps(pair)[1:-1]});\n" for pair in PREFERENCES.items())
        )
        log = Path(folder) / "log"
        with log.open("wb") as output:
            words = f"--headless --no-remote --profile {profile} --remote-debugging-port=0"
            process = subprocess.Popen(
                [FIREFOX, *words.split()],
                stdout=output,
                stderr=subprocess.STDOUT,
                env={"HOME": folder, "PATH": "/usr/bin:/bin", "LIBGL_ALWAYS_SOFTWARE": "1"},
            )
        try:
            ready = re.compile(r"WebDriver BiDi listening on (\S+)")
            address = wait_for(lambda: ready.search(log.read_text(errors="replace")), 60, "Firefox")
            browser = Firefox(address.group(1))
            yield browser
            browser.close()
        finally:
            process.terminate()
            process.wait(patient(20))
