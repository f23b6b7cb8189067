"""Requests to a repository with somebody's token, which goes to that repository alone: over HTTPS,
never to where a redirection leads, and into no message.
"""

import http.client
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any
from urllib.error import HTTPError, URLError
from urllib.parse import urlsplit
from urllib.request import HTTPRedirectHandler, OpenerDirector, Request, build_opener

SECONDS = 60.0  # without a byte, the network is lost
LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})
TOO_LARGE = frozenset({413, 507})
FULL = ("quota", "storage limit", "size limit", "exceeded")
Progress = Callable[[int], None]  # is told how many bytes were sent so far
AGAIN = "Run it again: files that have arrived are not sent twice."


class DepositError(RuntimeError):
    """A deposit that stopped; the text says why, and what to do."""


class NotThereError(DepositError):
    """What was asked for is not there, or no longer."""


class _NoRedirects(HTTPRedirectHandler):
    """A redirection is an error: the token must not follow it."""

    def redirect_request(self, *_args: Any) -> None:
        """Follow none."""


class _ReportedFile:
    """A file that tells how much of it was read."""

    def __init__(self, file: IO[bytes], progress: Progress) -> None:
        self._file, self._progress = file, progress
        self._sent = 0

    def read(self, size: int = -1) -> bytes:
        """Return the next part."""
        part = self._file.read(size)
        self._sent += len(part)
        self._progress(self._sent)
        return part


class RepositoryClient:
    """Requests to one repository.

    Args:
        address: of its API; other addresses must have the same host, or one in `domain`.
        token: of the person who deposits.
        scopes: what the token has to allow, for messages.
        domain: a domain all of whose hosts belong to the repository, such as `osf.io`.
    """

    def __init__(self, address: str, token: str, *, scopes: str, domain: str = "") -> None:
        self.address, self._token, self._scopes, self._domain = address, token, scopes, domain
        self._opener: OpenerDirector = build_opener(_NoRedirects)
        self._check(address)

    def ask(
        self, method: str, address: str, body: Any = None, kind: str = "application/json"
    ) -> Any:
        """Send JSON, and return the JSON of the answer; None where there is none.

        Raises:
            NotThereError: there is no such thing.
            DepositError: it was refused, or the network is lost.
        """
        data = None if body is None else json.dumps(body).encode()
        headers = {} if data is None else {"Content-Type": kind}
        return self._send(Request(address, data, headers, method=method))  # noqa: S310 -- checked

    def upload(self, address: str, path: Path, progress: Progress) -> Any:
        """Send a file by PUT as it is read, and return the JSON of the answer.

        Raises:
            DepositError: it was refused, or the network is lost.
        """
        headers = {
            "Content-Type": "application/octet-stream",
            "Content-Length": str(path.stat().st_size),
        }
        with path.open("rb") as file:
            counted: Any = _ReportedFile(file, progress)
            request = Request(address, counted, headers, method="PUT")  # noqa: S310 -- checked
            return self._send(request)

    def _check(self, address: str) -> None:
        own, other = urlsplit(self.address), urlsplit(address)
        host = other.hostname or ""
        is_own = host == own.hostname or (self._domain and f".{host}".endswith(f".{self._domain}"))
        if not is_own or not (other.scheme == "https" or host in LOOPBACK):
            raise DepositError(
                f"The token is only sent to {own.hostname} over HTTPS, not to "
                f"{other.scheme}://{host}."
            )

    def _send(self, request: Request) -> Any:
        self._check(request.full_url)
        request.add_header("Authorization", f"Bearer {self._token}")
        request.add_header("Accept", "application/json")
        try:
            with self._opener.open(request, timeout=SECONDS) as answer:
                text = answer.read()
        except HTTPError as error:
            raise self._refusal(error) from None
        except (URLError, OSError, http.client.HTTPException) as error:
            reason = getattr(error, "reason", error)
            raise DepositError(
                f"The connection to {urlsplit(self.address).hostname} was lost ({reason}). {AGAIN}"
            ) from None
        try:
            return json.loads(text) if text else None
        except ValueError:
            raise DepositError("The repository answered something other than JSON.") from None

    def _refusal(self, error: HTTPError) -> DepositError:
        host, said = urlsplit(self.address).hostname, _said(error)
        if error.code == 401:
            return DepositError(
                f"{host} does not accept the token: it is incomplete, expired, or from another "
                "service. A sandbox needs a token of its own."
            )
        if error.code in TOO_LARGE or any(word in said.lower() for word in FULL):
            return DepositError(f"There is not enough space left at {host}: {said}")
        if error.code == 403:
            return DepositError(
                f"The token does not allow this at {host}. Make one with {self._scopes}. {said}"
            )
        if error.code in {404, 410}:
            return NotThereError(f"{host} does not have it (any more): {said}")
        if error.code == 429:
            return DepositError(f"{host} gets too many requests. Wait a few minutes. {AGAIN}")
        if error.code >= 500:
            return DepositError(f"{host} has a fault ({error.code}). Try again later. {AGAIN}")
        return DepositError(f"{host} refused it ({error.code}): {said}")


def _said(error: HTTPError) -> str:
    """Return what a refusal says: the message and what is wrong with which field."""
    try:
        found = json.loads(error.read())
    except (ValueError, OSError):
        return error.reason or ""
    if not isinstance(found, Mapping):
        return str(found)[:300]
    parts = [str(found.get("message") or "")]
    for one in found.get("errors") or ():
        if isinstance(one, Mapping):
            source = one.get("source") or {}
            field = one.get("field") or source.get("pointer", "")
            what = one.get("message") or one.get("detail") or one.get("messages") or ""
            parts.append(f"{field}: {what}" if field else str(what))
    return "; ".join(filter(None, parts))[:500]
