"""A bot's browser as far as HTTP goes: cookies, redirects, forms with their tokens. What it does
not understand it says.
"""

import http.client
import http.cookiejar
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterable
from dataclasses import dataclass

from experiments.bots import page
from experiments.bots.page import HtmlForm, HtmlPage

TIMEOUT = 300.0  # of patience, also where a computer has other work
TOO_MANY = 429
PATIENCE = 12  # attempts while the site says that too many come at once
AGENT = "Mozilla/5.0 (X11; Linux x86_64) TelepresenceBot/1.0"


class BrowserError(Exception):
    """The site could not be reached, or answered with what no visitor should see."""


@dataclass(frozen=True)
class HttpAnswer:
    """What came: its address after all redirects, its status, and the page."""

    url: str
    status: int
    page: HtmlPage
    body: bytes = b""

    @property
    def path(self) -> str:
        """The address without the site."""
        return urllib.parse.urlsplit(self.url).path


class Browser:
    """One visitor's browser. All calls block.

    Args:
        site: where the site is, such as http://127.0.0.1:8000.
        agent: what it says of itself; research counts devices by it.
        language: what it asks for.
    """

    def __init__(self, site: str, agent: str = AGENT, language: str = "en") -> None:
        self.site = site.rstrip("/")
        self.jar = http.cookiejar.CookieJar()
        self._opener = urllib.request.build_opener(
            urllib.request.HTTPCookieProcessor(self.jar), urllib.request.ProxyHandler({})
        )
        self._headers = {
            "User-Agent": agent,
            "Accept-Language": language,
            "Accept": "text/html,application/json",
        }

    @property
    def headers(self) -> dict[str, str]:
        """What a WebSocket of this browser says when it knocks."""
        cookies = "; ".join(f"{cookie.name}={cookie.value}" for cookie in self.jar)
        return {"Cookie": cookies, "Origin": self.site, "User-Agent": self._headers["User-Agent"]}

    def get(self, address: str) -> HttpAnswer:
        """Follow an address.

        Raises:
            BrowserError: nothing came, or an error of the server.
        """
        return self._ask(urllib.request.Request(self._absolute(address), headers=self._headers))

    def post(self, address: str, fields: Iterable[tuple[str, str]]) -> HttpAnswer:
        """Send fields, in order, as a form does.

        Raises:
            BrowserError: as `get`.
        """
        url = self._absolute(address)
        body = urllib.parse.urlencode(list(fields)).encode()
        request = urllib.request.Request(
            url, data=body, headers={**self._headers, "Origin": self.site, "Referer": url}
        )
        return self._ask(request)

    def send(
        self, here: HttpAnswer, form: HtmlForm, fields: Iterable[tuple[str, str]], button: int = 0
    ) -> HttpAnswer:
        """Send a form of the page that one is on, with one of its buttons."""
        pressed = form.buttons[button] if form.buttons else None
        named = [(pressed.name, pressed.value)] if pressed is not None and pressed.name else []
        address = (pressed.action if pressed is not None else "") or form.action
        return self.post(urllib.parse.urljoin(here.url, address), [*form.hidden, *fields, *named])

    def _absolute(self, address: str) -> str:
        return urllib.parse.urljoin(f"{self.site}/", address)

    def _ask(self, request: urllib.request.Request) -> HttpAnswer:
        for attempt in range(1, PATIENCE + 1):
            answer = self._once(request)
            if answer.status != TOO_MANY:
                break
            time.sleep(float(attempt))
        if answer.status >= http.client.INTERNAL_SERVER_ERROR:
            raise BrowserError(
                f"{request.get_method()} {answer.path} answered with status {answer.status}"
            )
        return answer

    def _once(self, request: urllib.request.Request) -> HttpAnswer:
        try:
            with self._opener.open(request, timeout=TIMEOUT) as response:
                return _answer(
                    response.url,
                    response.status,
                    response.headers.get_content_type(),
                    response.read(),
                )
        except urllib.error.HTTPError as error:
            return _answer(error.url, error.code, error.headers.get_content_type(), error.read())
        except (OSError, http.client.HTTPException) as error:
            raise BrowserError(f"{request.full_url} cannot be reached: {error}") from error


def _answer(url: str, status: int, kind: str, body: bytes) -> HttpAnswer:
    is_page = kind == "text/html"
    return HttpAnswer(
        url,
        status,
        page.read(body.decode(errors="replace")) if is_page else HtmlPage(),
        b"" if is_page else body,
    )
