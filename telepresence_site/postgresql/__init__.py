"""A PostgreSQL cluster with one primary: a DATABASE_URL with several hosts, and connections to it
(base.py).
"""

import re
from typing import Any

import dj_database_url

ENGINE = "telepresence_site.postgresql"
PORT = "5432"
CONNECT_SECONDS = 3  # in which a server must answer a new connection
_URL = re.compile(
    r"(?P<before>(?:postgres|postgresql|pgsql)://(?:[^/?#]*@)?)"
    r"(?P<hosts>[^/?#@]*,[^/?#@]*)(?P<after>.*)"
)
_HOST = re.compile(r"\[?(?P<host>[^\[\]:]+|(?<=\[)[0-9A-Fa-f:.]+(?=\]))\]?(?::(?P<port>[0-9]+))?")


def is_address(url: str) -> bool:
    """Tell whether a DATABASE_URL names several PostgreSQL servers."""
    return _URL.fullmatch(url) is not None


def database(url: str) -> dict[str, Any]:
    """Return Django's settings for a database on several servers, in the order of the URL.

    Raises:
        ValueError: it is not such an address.
    """
    found = _URL.fullmatch(url)
    hosts = [_HOST.fullmatch(word.strip()) for word in found["hosts"].split(",")] if found else []
    if found is None or None in hosts:
        raise ValueError("DATABASE_URL must be postgres://user@host1:port,host2:port/name.")
    described: dict[str, Any] = dict(dj_database_url.parse(found["before"] + found["after"]))
    given = described.pop("OPTIONS", {})
    return described | {
        "ENGINE": ENGINE,
        "HOST": ",".join(host["host"] for host in hosts if host),
        "PORT": ",".join(host["port"] or PORT for host in hosts if host),
        "OPTIONS": {"target_session_attrs": "read-write", "connect_timeout": CONNECT_SECONDS}
        | given,
    }
