"""A PostgreSQL cluster with one primary: a DATABASE_URL with several hosts, and connections to it
(base.py).
"""

import re
from typing import Any

ENGINE = "telepresence_site.postgresql"
PORT = "5432"
CONNECT_SECONDS = 3  # in which a server must answer a new connection
_SEVERAL_HOSTS = re.compile(r"postgres(ql)?://([^/?#]*@)?[^/?#@]*,")


def is_address(url: str) -> bool:
    """Tell whether a DATABASE_URL names several PostgreSQL servers."""
    return _SEVERAL_HOSTS.match(url) is not None


def database(url: str) -> dict[str, Any]:
    """Return Django's settings for a database on several servers, in the order of the URL.

    Raises:
        ValueError: it is not such an address.
    """
    from psycopg import ProgrammingError, conninfo  # noqa: PLC0415 -- other databases lack it

    try:
        given = conninfo.conninfo_to_dict(url)
    except ProgrammingError:
        given = {}
    hosts = str(given.pop("host", "")).split(",")
    ports = [port or PORT for port in str(given.pop("port", "")).split(",")]
    if not (all(hosts) and all(map(str.isdecimal, ports))):
        # without libpq's reason, which contains the password
        raise ValueError("DATABASE_URL must be postgres://user@host1:port,host2:port/name.")
    return {
        "ENGINE": ENGINE,
        "NAME": given.pop("dbname", ""),
        "USER": given.pop("user", ""),
        "PASSWORD": given.pop("password", ""),
        "HOST": ",".join(hosts),
        "PORT": ",".join(ports),
        "OPTIONS": {"target_session_attrs": "read-write", "connect_timeout": CONNECT_SECONDS}
        | given,
    }
