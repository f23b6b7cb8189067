"""A real Chromium that watches a robot: a static page, with signalling in this process."""

import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

from playwright.async_api import Browser, Page, async_playwright

from robots.agent.media import MediaSide
from robots.api.messages import Candidate, Role, SdpOffer
from tests.support.browsers.chromium import CHROMIUM, FLAGS
from tests.support.media.loopback_peer import Exchange
from tests.support.patience import patient, until

PAGE = Path(__file__).with_name("browser_page.html")


@asynccontextmanager
async def chromium() -> AsyncIterator[tuple[Browser, str]]:
    """Start Chromium and a server of the page; yield the browser and the page's address."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), _OnePage)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        async with async_playwright() as playwright:
            browser = await playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
            try:
                yield browser, f"http://127.0.0.1:{server.server_address[1]}/"
            finally:
                await browser.close()
    finally:
        server.shutdown()
        server.server_close()


class BrowserPage:
    """One page in Chromium as a peer of a MediaSide."""

    def __init__(
        self, page: Page, media: MediaSide, exchange: Exchange, peer: str, role: Role
    ) -> None:
        self.page, self.media, self.exchange = page, media, exchange
        self.peer, self.role = peer, role

    @classmethod
    async def open(
        cls,
        browser: Browser,
        address: str,
        media: MediaSide,
        exchange: Exchange,
        peer: str,
        *,
        role: Role = "observer",
    ) -> "BrowserPage":
        """Open the page, which does not offer before `watch`."""
        self = cls(await (await browser.new_context()).new_page(), media, exchange, peer, role)
        await self.page.expose_function("sendOffer", self._offer)
        await self.page.expose_function("sendCandidate", self._candidate)
        await self.page.goto(address)
        return self

    async def watch(self, **options: Any) -> None:
        await self.page.evaluate("options => watch(options)", options)

    async def report(self) -> dict[str, Any]:
        return await self.page.evaluate("() => report")

    async def report_when(self, condition: str, timeout: float = 15.0) -> dict[str, Any]:
        """Wait until a JavaScript condition on `report` holds and return the report."""
        await self.page.wait_for_function(f"() => {condition}", timeout=1000 * patient(timeout))
        return await self.report()

    async def _offer(self, sdp: str) -> str | None:
        answered = len(self.exchange.answers(self.peer))
        self.media.signal(self.peer, SdpOffer(sdp=sdp, role=self.role))
        answers = lambda: self.exchange.answers(self.peer)
        await until(lambda: len(answers()) > answered or self.exchange.byes(self.peer))
        return answers()[-1] if len(answers()) > answered else None

    def _candidate(self, candidate: dict[str, Any]) -> None:
        message = Candidate(
            candidate=candidate["candidate"],
            sdp_mid=candidate.get("sdpMid"),
            sdp_m_line_index=candidate.get("sdpMLineIndex"),
        )
        self.media.signal(self.peer, message)


class _OnePage(BaseHTTPRequestHandler):
    protocol_version: ClassVar[str] = "HTTP/1.1"

    def do_GET(self) -> None:
        body = PAGE.read_bytes() if self.path == "/" else b""
        self.send_response(200 if body else 404)
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *args: Any) -> None:
        pass
