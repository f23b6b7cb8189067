"""A repository: drafts that their owner publishes, and their files.

Requests carry the depositor's token, which is sent to that repository alone: over HTTPS, never to
the target of a redirection, and in no message.
"""

import http.client
import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar
from urllib.error import HTTPError, URLError
from urllib.parse import urlsplit
from urllib.request import HTTPRedirectHandler, Request, build_opener

from experiments.definition.publication import PublicationDetails

TIMEOUT_S = 60.0  # without a byte
PART = 1 << 20
LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})
AGAIN = "Run it again: files that have arrived are not sent twice."
FULL = ("quota", "storage limit", "size limit", "exceeded")
NO_SPACE = "There is not enough space left at {host}: {answer}"
REFUSALS = {
    401: "{host} does not accept the token: it is incomplete, expired, or from another service. A "
    "sandbox needs a token of its own.",
    403: "The token does not allow this at {host}. Make one with {scopes}. {answer}",
    404: "{host} does not have it (any more): {answer}",
    410: "{host} does not have it (any more): {answer}",
    413: NO_SPACE,
    429: f"{{host}} gets too many requests. Wait a few minutes. {AGAIN}",
    507: NO_SPACE,
}
Tell = Callable[[str], None]
Headers = dict[str, str]


class DepositError(RuntimeError):
    """A deposit that stopped; the text says why, and what to do."""


class NotThereError(DepositError):
    """The requested object does not exist, or no longer."""


@dataclass(frozen=True)
class Record:
    title: str
    description: str
    details: PublicationDetails


@dataclass(frozen=True)
class DepositDraft:
    """A draft: its id, and the page on which its owner completes and publishes it."""

    id: str
    url: str


@dataclass(frozen=True)
class StoredFile:
    """A file in a draft; `address` is that of a new version, where the repository has one."""

    name: str
    size: int
    md5: str
    address: str = ""


class _NoRedirects(HTTPRedirectHandler):
    def redirect_request(self, *_args: Any) -> None:
        """Make a redirection an error."""


class Repository(ABC):
    """Drafts and files of one repository. `address` is that of its API; other addresses must have
    the same host, or one in `domain`. `token` is the depositor's.
    """

    title: ClassVar[str]
    home: ClassVar[str]  # address of its API
    sandbox: ClassVar[str]
    token: ClassVar[str]  # the environment variable
    scopes: ClassVar[str]  # that the token must have
    domain: ClassVar[str] = ""  # all of its hosts belong to the repository

    def __init__(self, address: str, token: str) -> None:
        self.address, self._token, self._opener = address, token, build_opener(_NoRedirects)
        self._check(address)

    def problems(self, record: Record) -> Iterator[str]:
        """Yield what the repository would refuse."""
        yield from ()

    @abstractmethod
    def create(self, record: Record) -> DepositDraft:
        """Make a draft, which only its owner sees."""

    @abstractmethod
    def update(self, draft: DepositDraft, record: Record) -> None:
        """Write a draft's description; one that is deleted is a NotThereError."""

    @abstractmethod
    def files(self, draft: DepositDraft) -> dict[str, StoredFile]:
        """Return the files of a draft, by name."""

    @abstractmethod
    def upload(self, draft: DepositDraft, name: str, path: Path, tell: Tell) -> StoredFile:
        """Add a file, or replace the one of that name; return what the repository has then."""

    # --- requests ---------------------------------------------------------------------------------

    def ask(
        self, method: str, address: str, body: Any = None, kind: str = "application/json"
    ) -> Any:
        """Send JSON, and return the JSON of the answer, None for an empty one. A missing object is
        a NotThereError; a refusal and a lost connection are another DepositError.
        """
        data = None if body is None else json.dumps(body).encode()
        return self._send(method, address, data, {} if data is None else {"Content-Type": kind})

    def put(self, address: str, path: Path, tell: Tell) -> Any:
        """Send a file as it is read, and return the JSON of the answer; raises as `ask` does."""
        headers = {"Content-Type": "application/octet-stream"}
        headers["Content-Length"] = str(path.stat().st_size)
        return self._send("PUT", address, _parts(path, tell), headers)

    def _check(self, address: str) -> None:
        own, other = urlsplit(self.address), urlsplit(address)
        host = other.hostname or ""
        is_own = host == own.hostname or (self.domain and f".{host}".endswith(f".{self.domain}"))
        if not is_own or not (other.scheme == "https" or host in LOOPBACK):
            target = f"{other.scheme}://{host}"
            text = f"The token is only sent to {own.hostname} over HTTPS, not to {target}."
            raise DepositError(text)

    def _send(
        self, method: str, address: str, data: bytes | Iterable[bytes] | None, headers: Headers
    ) -> Any:
        self._check(address)
        own = {"Authorization": f"Bearer {self._token}", "Accept": "application/json"}
        request = Request(address, data, headers | own, method=method)  # noqa: S310 -- checked
        try:
            with self._opener.open(request, timeout=TIMEOUT_S) as answer:
                text = answer.read()
        except HTTPError as error:
            raise self._refusal(error) from None
        except (URLError, OSError, http.client.HTTPException) as error:
            reason, host = getattr(error, "reason", error), urlsplit(self.address).hostname
            raise DepositError(f"The connection to {host} was lost ({reason}). {AGAIN}") from None
        try:
            return json.loads(text) if text else None
        except ValueError:
            raise DepositError("The repository answered something other than JSON.") from None

    def _refusal(self, error: HTTPError) -> DepositError:
        host, answer = urlsplit(self.address).hostname, _text_of(error)
        template = f"{{host}} refused it ({error.code}): {{answer}}"
        if error.code >= 500:
            template = f"{{host}} has a fault ({error.code}). Try again later. {AGAIN}"
        template = REFUSALS.get(error.code, template)
        if error.code != 401 and any(word in answer.lower() for word in FULL):
            template = NO_SPACE
        kind = NotThereError if error.code in {404, 410} else DepositError
        return kind(template.format(host=host, answer=answer, scopes=self.scopes))


def _parts(path: Path, tell: Tell) -> Iterator[bytes]:
    """Yield the parts of a file, and report each tenth of a large one."""
    size, sent, tenth = path.stat().st_size, 0, 0
    with path.open("rb") as file:
        while part := file.read(PART):
            yield part
            sent += len(part)
            if tenth < (reached := 10 * sent // size) < 10:
                tenth = reached
                tell(f"{path.name}: {10 * tenth} % of {megabytes(size)}")


def megabytes(size: int) -> str:
    return f"{size / 1e6:.2f} MB"


def _text_of(error: HTTPError) -> str:
    try:
        found = json.loads(error.read())
    except (ValueError, OSError):
        return error.reason or ""
    if not isinstance(found, Mapping):
        return str(found)[:300]
    parts = [str(found.get("message") or "")]
    for one in found.get("errors") or ():
        if isinstance(one, Mapping):
            field = one.get("field") or (one.get("source") or {}).get("pointer", "")
            what = one.get("message") or one.get("detail") or one.get("messages") or ""
            parts.append(f"{field}: {what}" if field else str(what))
    return "; ".join(filter(None, parts))[:500]
