"""What an agent makes of the answers of a server, over a real connection."""

import http.server
import json
import threading
from collections.abc import Iterator

import pytest

from robots.agent.broker_link.broker_discovery import ServerAwayError, ask
from robots.agent.broker_link.enrolment import enrol, renew
from robots.agent.config import ConfigError, load

GOOD = {"robot": "giraff", "user": "giraff.1", "token": "fresh"}


class Server(http.server.ThreadingHTTPServer):
    """Answers every request with `answer`, and keeps the requests."""

    answer: tuple[int, bytes] = (200, b"")

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Answering)
        self.asked: list[tuple[str, str, bytes]] = []

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}"


class Answering(http.server.BaseHTTPRequestHandler):
    server: Server

    def do_GET(self) -> None:
        self.do_POST()

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        self.server.asked.append((self.path, self.headers.get("Authorization", ""), body))
        code, content = self.server.answer
        self.send_response(code)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_args: object) -> None:
        """Log no request."""


@pytest.fixture
def server() -> Iterator[Server]:
    with Server() as running:
        thread = threading.Thread(target=running.serve_forever, daemon=True)
        thread.start()
        yield running
        running.shutdown()
        thread.join()


def test_a_token_travels_in_the_body_and_the_answer_is_kept(server, tmp_path):
    server.answer = (200, json.dumps(GOOD).encode())
    file = tmp_path / "deep" / "giraff.toml"
    enrol("giraff", f"{server.url}/", "once", file)
    assert server.asked == [("/api/v1/agent/enrol/", "", b'{"robot": "giraff", "token": "once"}')]
    config = load(
        {"robot": "giraff", "credentials": file, "var": tmp_path, "adapter": "simulator"}, {}
    )
    assert (config.token, config.user, config.server) == ("fresh", "giraff.1", server.url)


@pytest.mark.parametrize(
    ("code", "content", "words"),
    [
        (403, b'{"detail": "This token was used."}', "This token was used"),
        (421, b'{"detail": "giraff is served by https://n."}', "giraff is served by https://n"),
        (403, b"<html>", "it answered 403"),
        (404, b"", "it answered 404"),
        (500, b"", r"the request to \S+ failed: it answered with HTTP status 500"),
        (429, b"", "it answered with HTTP status 429"),
        (200, b"nonsense", r"the request to \S+ failed"),
        (200, b"[]", "its answer is invalid"),
        (200, b'{"robot": "rhodon", "token": "t"}', "its answer is invalid"),
        (200, b'{"robot": "giraff"}', "its answer is invalid"),
    ],
)
def test_an_answer_that_is_none_is_told_in_one_sentence_and_nothing_is_kept(
    server, tmp_path, code, content, words
):
    server.answer = (code, content)
    with pytest.raises(ConfigError, match=words):
        enrol("giraff", server.url, "once", tmp_path / "giraff.toml")
    assert not list(tmp_path.iterdir())


def test_a_file_that_cannot_be_written_is_told(server, tmp_path):
    server.answer = (200, json.dumps(GOOD).encode())
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(ConfigError, match="cannot be saved"):
        enrol("giraff", server.url, "once", tmp_path / "file" / "giraff.toml")


def test_present_credentials_are_shown_to_get_new_ones_and_stay_when_there_is_no_answer(
    server, tmp_path
):
    file = tmp_path / "giraff.toml"
    file.write_text(f'robot = "giraff"\ntoken = "old"\nserver = "{server.url}"\n')
    config = load(
        {"robot": "giraff", "credentials": file, "var": tmp_path, "adapter": "simulator"}, {}
    )
    server.answer = (503, b"")
    with pytest.raises(ServerAwayError):
        renew(config)
    assert 'token = "old"' in file.read_text()
    server.answer = (200, json.dumps(GOOD).encode())
    assert renew(config) == GOOD
    assert server.asked[-1] == ("/api/v1/agent/renew/", "Bearer giraff:old", b"{}")
    assert (
        load(
            {"robot": "giraff", "credentials": file, "var": tmp_path, "adapter": "simulator"}, {}
        ).token
        == "fresh"
    )


def test_a_server_that_is_not_there_is_told(tmp_path):
    with pytest.raises(ConfigError, match=r"the request to \S+ failed"):
        enrol("giraff", "http://127.0.0.1:9", "once", tmp_path / "giraff.toml")


def test_an_agent_at_the_wrong_site_ends_with_the_address_of_the_right_one(server, tmp_path):
    server.answer = (421, b'{"detail": "giraff is served by https://n."}')
    given = {"robot": "giraff", "server": server.url, "adapter": "simulator", "var": tmp_path}
    config = load(given, {"TELEPRESENCE_TOKEN": "of-the-north"})
    with pytest.raises(ConfigError, match=r"giraff is served by https://n\."):
        ask(config)
    assert [path for path, _, _ in server.asked] == ["/api/v1/agent/"]
