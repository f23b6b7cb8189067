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
from urllib.request import ProxyHandler

from websockets.asyncio.client import ClientConnection, connect

from experiments.bots.page import Button, HtmlForm, HtmlPage

TIMEOUT_S = 300.0  # a busy computer answers late
ATTEMPTS = 12  # while the site answers that there are too many requests
AGENT = "Mozilla/5.0 (X11; Linux x86_64) TelepresenceBot/1.0"


class BrowserError(Exception):
    """The site could not be reached, or answered with an error of the server."""


@dataclass(frozen=True)
class HttpAnswer:
    """An answer; `url` is its address after all redirects, `page` is empty without one."""

    url: str
    status: int
    page: HtmlPage
    body: bytes = b""

    @property
    def path(self) -> str:
        return urllib.parse.urlsplit(self.url).path


async def open_websocket(url: str, headers: Mapping[str, str]) -> ClientConnection:
    """Open a WebSocket (address as http:// or https://) as a page does: without extensions, and
    without pings of its own. Raises a WebSocketException when the server refuses it, an OSError
    when the site cannot be reached.
    """
    return await connect(
        f"ws{url.removeprefix('http')}",
        additional_headers=headers,
        user_agent_header=None,
        compression=None,
        open_timeout=30.0,
        ping_interval=None,
        max_size=4 * 1024 * 1024,
        proxy=None,
    )


class Browser:
    """One visitor's browser on a site such as http://127.0.0.1:8000. Its requests block. `agent` is
    the User-Agent, by which studies count devices.
    """

    def __init__(self, site: str, agent: str = AGENT) -> None:
        self.site, self._agent = site.rstrip("/"), agent
        self.jar = http.cookiejar.CookieJar()
        cookies, no_proxy = urllib.request.HTTPCookieProcessor(self.jar), ProxyHandler({})
        self._opener = urllib.request.build_opener(cookies, no_proxy)
        accepts = {"Accept-Language": "en", "Accept": "text/html,application/json"}
        self._opener.addheaders = [("User-Agent", agent), *accepts.items()]

    async def websocket(self, path: str) -> ClientConnection:
        cookies = "; ".join(f"{cookie.name}={cookie.value}" for cookie in self.jar)
        headers = {"Cookie": cookies, "Origin": self.site, "User-Agent": self._agent}
        return await open_websocket(self.site + path, headers)

    def send(
        self,
        here: HttpAnswer,
        form: HtmlForm,
        fields: Iterable[tuple[str, str]],
        button: Button | None = None,
    ) -> HttpAnswer:
        """Send a form of the current page with one of its buttons, by default the first; a
        BrowserError as in `open`.
        """
        pressed = button or next(iter(form.buttons), Button())
        named = [(pressed.name, pressed.value)] if pressed.name else []
        body = urllib.parse.urlencode([*form.hidden, *fields, *named]).encode()
        return self.open(urllib.parse.urljoin(here.url, pressed.action or form.action), body)

    def open(self, address: str, body: bytes | None = None) -> HttpAnswer:
        """Follow an address, or send the body of a form to it; a BrowserError when there is no
        answer, or it is an error of the server.
        """
        url = urllib.parse.urljoin(f"{self.site}/", address)
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
            if answer.status != http.client.TOO_MANY_REQUESTS:
                break
            time.sleep(float(attempt))
        if answer.status >= http.client.INTERNAL_SERVER_ERROR:
            method = request.get_method()
            raise BrowserError(f"{method} {answer.path} answered with status {answer.status}")
        return answer


def _answer(response: urllib.response.addinfourl) -> HttpAnswer:
    body = response.read()
    is_page = response.headers.get_content_type() == "text/html"
    page = HtmlPage(body.decode(errors="replace") if is_page else "")
    return HttpAnswer(response.url, response.status or 0, page, body)
