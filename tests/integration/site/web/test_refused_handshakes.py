"""A refused request leaves one line in the log of a web process, and no traceback."""

import socket

import pytest

from tests.support.patience import patient
from tests.support.programs.server import web_alone
from tests.support.sessions.site import LOOPBACK

UPGRADE = (
    "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    with web_alone(tmp_path_factory.mktemp("site") / "var") as site:
        yield site


def status(site, path, *headers):
    """Return the status of the answer to a request, and what it added to the log."""
    before = len(site.log("web"))
    lines = "".join(f"{header}\r\n" for header in headers)
    address = (LOOPBACK, site.web_port)
    with socket.create_connection(address, timeout=patient(10)) as connection:
        connection.sendall(f"GET {path} HTTP/1.1\r\n{lines}\r\n".encode())
        answer = connection.recv(4096).decode("latin-1")
    return int(answer.split()[1]), site.log("web")[before:]


def test_websocket_to_an_unknown_path_is_not_found(site):
    headers = (f"Host: {LOOPBACK}:{site.web_port}", f"Origin: {site.url}", UPGRADE.strip())
    for path in ("/ws/nowhere/", "/", "/ws/robots/giraff/nowhere/", "/ws/check"):
        code, logged = status(site, path, *headers)
        assert (code, "Traceback" in logged) == (404, False), (path, logged)
    assert status(site, "/ws/check/", *headers)[0] == 101


@pytest.mark.parametrize("host", ["a, Host: b", "evil.example.org", "a b", ""])
def test_request_to_a_foreign_host_leaves_no_traceback(site, host):
    code, logged = status(site, "/", f"Host: {host}")
    assert (code, "Traceback" in logged) == (400, False), logged
