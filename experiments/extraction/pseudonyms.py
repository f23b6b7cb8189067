"""Names that tell nothing: the same thing has the same one within a study, and nobody without the
study's secret finds what it stands for.
"""

import hashlib
import hmac
import re

LETTERS = "23456789ABCDEFGHJKLMNPQRSTUVWXYZ"  # nothing that is read as something else
LENGTH = 10
_HASHED = re.compile(rf"N[{LETTERS}]{{{LENGTH}}}")
_UUID = re.compile(r"[0-9a-fA-F]{8}-(?:[0-9a-fA-F]{4}-){3}[0-9a-fA-F]{12}")


class Pseudonyms:
    """The names of one study's sessions, responses and networks, made from its secret (RFC 2104,
    SHA-256).
    """

    def __init__(self, secret: str) -> None:
        self._key = secret.encode()

    def session(self, key: object) -> str:
        return "S" + self._code("session", str(key))

    def response(self, key: object) -> str:
        return "R" + self._code("response", str(key))

    def network(self, network: str) -> str:
        """Return a hash by which networks are counted; empty for one that is not known, and what is
        such a hash already stays.
        """
        return (
            "N" + self._code("network", network)
            if network and not _HASHED.fullmatch(network)
            else network
        )

    def thing(self, name: str) -> str:
        """Return the code of anything else that has a name of its own: an action, a run of an
        agent.
        """
        return "X" + self._code("thing", name)

    def in_text(self, text: str) -> str:
        """Return text in which keys of database rows have become codes."""
        return _UUID.sub(lambda found: self.thing(found.group().lower()), text)

    def _code(self, kind: str, name: str) -> str:
        number = int.from_bytes(
            hmac.digest(self._key, f"{kind}:{name}".encode(), hashlib.sha256)[:8]
        )
        letters = []
        for _ in range(LENGTH):
            number, at = divmod(number, len(LETTERS))
            letters.append(LETTERS[at])
        return "".join(letters)
