"""A bot's browser: cookies, redirects, forms with their tokens, and WebSockets."""

import http.client
import http.cookiejar
import time
import urllib.error
import urllib.parse
import urllib.request
import urllib.response
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from websockets.asyncio.client import ClientConnection, connect

from experiments.bots.page import HtmlForm, HtmlPage

TIMEOUT_S = 300.0  # a computer that has other work answers late
WEBSOCKET_TIMEOUT_S = 30.0
MAX_MESSAGE = 4 * 1024 * 1024
TOO_MANY = 429
ATTEMPTS = 12  # while the site answers that too many requests come at once
AGENT = "Mozilla/5.0 (X11; Linux x86_64) TelepresenceBot/1.0"


class BrowserError(Exception):
    """The site could not be reached, or answered with an error of the server."""


@dataclass(frozen=True)
class HttpAnswer:
    """An answer: its address after all redirects, its status, and the page or else the body."""

    url: str
    status: int
    page: HtmlPage
    body: bytes = b""

    @property
    def path(self) -> str:
        return urllib.parse.urlsplit(self.url).path


async def open_websocket(url: str, headers: Mapping[str, str]) -> ClientConnection:
    """Open a WebSocket as a page does: without extensions, and without pings of its own.

    Args:
        url: its address, as http:// or https://.
        headers: of the request.

    Raises:
        WebSocketException: the server refuses it.
        OSError: the site cannot be reached.
    """
    return await connect(
        f"ws{url.removeprefix('http')}",
        additional_headers=headers,
        user_agent_header=None,
        compression=None,
        open_timeout=WEBSOCKET_TIMEOUT_S,
        ping_interval=None,
        max_size=MAX_MESSAGE,
        proxy=None,
    )


class Browser:
    """One visitor's browser. Its requests block.

    Args:
        site: the site's address, such as http://127.0.0.1:8000.
        agent: the User-Agent, by which studies count devices.
    """

    def __init__(self, site: str, agent: str = AGENT) -> None:
        self.site, self._agent = site.rstrip("/"), agent
        self.jar = http.cookiejar.CookieJar()
        self._opener = urllib.request.build_opener(
            urllib.request.HTTPCookieProcessor(self.jar), urllib.request.ProxyHandler({})
        )
        self._opener.addheaders = [
            ("User-Agent", agent),
            ("Accept-Language", "en"),
            ("Accept", "text/html,application/json"),
        ]

    async def websocket(self, path: str) -> ClientConnection:
        """Open a WebSocket of the site; see `open_websocket`."""
        cookies = "; ".join(f"{cookie.name}={cookie.value}" for cookie in self.jar)
        headers = {"Cookie": cookies, "Origin": self.site, "User-Agent": self._agent}
        return await open_websocket(self.site + path, headers)

    def get(self, address: str) -> HttpAnswer:
        """Follow an address.

        Raises:
            BrowserError: there is no answer, or it is an error of the server.
        """
        return self._request(self._absolute(address))

    def post(self, address: str, fields: Iterable[tuple[str, str]]) -> HttpAnswer:
        """Send fields, in order, as a form does.

        Raises:
            BrowserError: as `get`.
        """
        return self._request(self._absolute(address), urllib.parse.urlencode(list(fields)).encode())

    def send(
        self, here: HttpAnswer, form: HtmlForm, fields: Iterable[tuple[str, str]], button: int = 0
    ) -> HttpAnswer:
        """Send a form of the current page with one of its buttons.

        Raises:
            BrowserError: as `get`.
        """
        pressed = form.buttons[button] if form.buttons else None
        named = [(pressed.name, pressed.value)] if pressed is not None and pressed.name else []
        address = (pressed.action if pressed is not None else "") or form.action
        return self.post(urllib.parse.urljoin(here.url, address), [*form.hidden, *fields, *named])

    def _absolute(self, address: str) -> str:
        return urllib.parse.urljoin(f"{self.site}/", address)

    def _request(self, url: str, body: bytes | None = None) -> HttpAnswer:
        headers = {} if body is None else {"Origin": self.site, "Referer": url}
        request = urllib.request.Request(url, body, headers)
        for attempt in range(1, ATTEMPTS + 1):
            try:
                with self._opener.open(request, timeout=TIMEOUT_S) as response:
                    return _answer(response)
            except urllib.error.HTTPError as error:
                with error:
                    answer = _answer(error)
            except (OSError, http.client.HTTPException) as error:
                raise BrowserError(f"{url} cannot be reached: {error}") from error
            if answer.status != TOO_MANY:
                break
            time.sleep(float(attempt))
        if answer.status >= http.client.INTERNAL_SERVER_ERROR:
            method = request.get_method()
            raise BrowserError(f"{method} {answer.path} answered with status {answer.status}")
        return answer


def _answer(response: urllib.response.addinfourl) -> HttpAnswer:
    body = response.read()
    if response.headers.get_content_type() != "text/html":
        return HttpAnswer(response.url, response.status or 0, HtmlPage(), body)
    return HttpAnswer(response.url, response.status or 0, HtmlPage(body.decode(errors="replace")))
