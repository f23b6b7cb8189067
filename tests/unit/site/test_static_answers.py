"""Static files that are answered without Django."""

import asyncio
import threading
from typing import Any

import pytest
from whitenoise import WhiteNoise

from telepresence_site.web.static_answers import StaticAnswers
from tests.support.loop_gap import longest_gap
from tests.support.patience import patient

SCRIPT = b"export const answer = 42;\n" * 40


@pytest.fixture
def files(tmp_path) -> dict[str, Any]:
    (tmp_path / "drive.js").write_bytes(SCRIPT)
    return WhiteNoise(None, root=str(tmp_path), prefix="static/", max_age=60).files


def ask(
    app: StaticAnswers, path: str, method: str = "GET", scheme: str = "http", **headers: str
) -> tuple[int, dict[bytes, bytes], bytes]:
    """Return status, headers and body of an answer."""
    sent: list[dict[str, Any]] = []

    async def send(message: dict[str, Any]) -> None:
        sent.append(message)

    pairs = [(name.replace("_", "-").encode(), value.encode()) for name, value in headers.items()]
    asyncio.run(app(scope_of(path, method, scheme, pairs), None, send))
    return sent[0]["status"], dict(sent[0]["headers"]), sent[1]["body"]


def scope_of(path: str, method: str, scheme: str, headers: list) -> dict[str, Any]:
    return {"type": "http", "method": method, "path": path, "scheme": scheme, "headers": headers}


async def django(_scope: Any, _receive: Any, send: Any) -> None:
    await send({"type": "http.response.start", "status": 418, "headers": []})
    await send({"type": "http.response.body", "body": b""})


def test_a_static_file_is_answered_with_its_caching_headers(files):
    status, headers, body = ask(StaticAnswers(django, files), "/static/drive.js")
    assert (status, body, int(headers[b"content-length"])) == (200, SCRIPT, len(SCRIPT))
    assert headers[b"content-type"].startswith(b"text/javascript")
    assert headers[b"cache-control"] == b"max-age=60, public"
    assert headers[b"x-content-type-options"] == b"nosniff"
    assert headers[b"cross-origin-resource-policy"] == b"same-origin"


def test_a_cached_file_is_answered_with_304_and_head_without_a_body(files):
    app = StaticAnswers(django, files)
    etag = ask(app, "/static/drive.js")[1][b"etag"].decode()
    assert ask(app, "/static/drive.js", if_none_match=etag)[::2] == (304, b"")
    status, headers, body = ask(app, "/static/drive.js", "HEAD")
    assert (status, int(headers[b"content-length"]), body) == (200, len(SCRIPT), b"")


def test_everything_else_is_left_to_django(files):
    assert ask(StaticAnswers(django, files), "/static/missing.js")[0] == 418
    assert ask(StaticAnswers(django, files), "/static/drive.js", "POST")[0] == 418
    secure = StaticAnswers(django, files, secure_only=True)
    assert ask(secure, "/static/drive.js")[0] == 418, "Django redirects to HTTPS"
    assert ask(secure, "/static/drive.js", scheme="https")[0] == 200


async def test_a_disk_that_hangs_does_not_block_the_event_loop(files, monkeypatch):
    app, may_answer = StaticAnswers(django, files), threading.Event()
    file = files["/static/drive.js"]
    right = file.get_response

    def hangs(*arguments):
        may_answer.wait(patient(20))
        return right(*arguments)

    monkeypatch.setattr(file, "get_response", hangs)
    sent = []

    async def send(message):
        sent.append(message)

    scope = scope_of("/static/drive.js", "GET", "http", [])
    async with longest_gap() as gap:
        answer = asyncio.create_task(app(scope, None, send))
        await asyncio.sleep(0.1)
        assert not answer.done()
        may_answer.set()
        await asyncio.wait_for(answer, patient(10))
    assert gap() < patient(0.5)
    assert sent[1]["body"] == SCRIPT
