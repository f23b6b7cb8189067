"""Pseudonyms: within a study each thing has one, which cannot be traced without its secret."""

import hashlib
import hmac
import re

LETTERS = "23456789ABCDEFGHJKLMNPQRSTUVWXYZ"  # without those that look alike
LENGTH = 10
_HASHED = re.compile(rf"N[{LETTERS}]{{{LENGTH}}}")
_UUID = re.compile(r"[0-9a-fA-F]{8}-(?:[0-9a-fA-F]{4}-){3}[0-9a-fA-F]{12}")


class Pseudonyms:
    """Codes of one study's sessions, responses and networks, by HMAC (RFC 2104) with SHA-256."""

    def __init__(self, secret: str) -> None:
        self._key = secret.encode()

    def session(self, key: object) -> str:
        return "S" + self._code("session", str(key))

    def response(self, key: object) -> str:
        return "R" + self._code("response", str(key))

    def network(self, network: str) -> str:
        """Return a hash for counting networks; an unknown network and a hash stay as they are."""
        is_plain = network and not _HASHED.fullmatch(network)
        return "N" + self._code("network", network) if is_plain else network

    def thing(self, name: str) -> str:
        """Return the code of another thing with a name, such as an action or a run of an agent."""
        return "X" + self._code("thing", name)

    def in_text(self, text: str) -> str:
        """Return text in which keys of database rows have become codes."""
        return _UUID.sub(lambda found: self.thing(found.group().lower()), text)

    def _code(self, kind: str, name: str) -> str:
        digest = hmac.digest(self._key, f"{kind}:{name}".encode(), hashlib.sha256)
        number = int.from_bytes(digest[:8])
        letters = []
        for _ in range(LENGTH):
            number, at = divmod(number, len(LETTERS))
            letters.append(LETTERS[at])
        return "".join(letters)
