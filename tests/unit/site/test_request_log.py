"""What every request leaves behind: an id, a line, and a figure."""

import logging

import pytest
from prometheus_client import REGISTRY

from robots.process import log_ids
from telepresence_site.web.request_log import RequestLog, route_of


async def ask(application, path="/about/", headers=(), method="GET", kind="http"):
    sent = []

    async def send(message):
        sent.append(message)

    await RequestLog(application)(
        {"type": kind, "path": path, "method": method, "headers": list(headers)}, None, send
    )
    return sent


async def answers(_scope, _receive, send):
    await send({"type": "http.response.start", "status": 204, "headers": [(b"x-own", b"1")]})
    await send({"type": "http.response.body", "body": b""})


async def test_an_answer_bears_an_id_that_its_lines_carry():
    seen = {}

    async def application(scope, receive, send):
        seen.update(log_ids.current())
        await answers(scope, receive, send)

    headers = dict((await ask(application, "/robots/giraff/"))[0]["headers"])
    assert headers[b"x-request-id"].decode() == seen["request"]
    assert headers[b"x-own"] == b"1"
    assert seen["robot"] == "giraff"
    assert log_ids.current().get("request") is None


@pytest.mark.parametrize(
    ("given", "taken"),
    [
        (b"0af7651916cd43dd8448eb211c80319c", True),
        (b"short", False),
        (b"evil\nline-of-a-log", False),
        (b"x" * 65, False),
    ],
)
async def test_a_proxys_id_is_taken_when_it_is_plain(given, taken):
    headers = dict((await ask(answers, headers=[(b"x-request-id", given)]))[0]["headers"])
    assert (headers[b"x-request-id"] == given) is taken


async def test_the_line_names_route_and_status_and_no_key(caplog):
    with caplog.at_level(logging.INFO, "telepresence.request"):
        await ask(answers, "/accounts/password/reset/key/3-s3cr3tkey/")
    line = caplog.messages[-1]
    assert "status=204" in line
    assert "s3cr3tkey" not in line
    assert "reset" in line


async def test_a_crash_is_noted_and_raised_to_the_server(caplog):
    async def application(*_):
        raise RuntimeError("of the test")

    with caplog.at_level(logging.INFO, "telepresence.request"), pytest.raises(RuntimeError):
        await ask(application)
    assert "status=0" in caplog.messages[-1]


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("/ws/robots/giraff/", "drive"),
        ("/ws/robots/giraff/screen/", "screen"),
        ("/ws/robots/giraff/wizard/", "wizard"),
        ("/ws/check/", "check"),
        ("/ws/nowhere/", "elsewhere"),
    ],
)
async def test_open_sockets_are_counted_by_kind(path, kind):
    inside = []

    async def application(*_):
        inside.append(REGISTRY.get_sample_value("telepresence_websockets", {"kind": kind}))

    await ask(application, path, kind="websocket")
    after = REGISTRY.get_sample_value("telepresence_websockets", {"kind": kind})
    assert inside == [after + 1]


def test_an_address_of_nothing_has_no_route():
    assert route_of("/no/such/page") == "elsewhere"
    assert route_of("/") == "/"
