"""How an agent handles the answers to its enrolment and renewal, over a real connection."""

from collections.abc import Iterator

import pytest

from robots.agent.broker_link.broker_discovery import ServerAwayError
from robots.agent.broker_link.enrolment import enrol, renew
from robots.agent.config import ConfigError, load
from tests.support.agents.agent_server import AgentServer

GOOD = {"robot": "giraff", "user": "giraff.1", "token": "fresh"}


@pytest.fixture
def server() -> Iterator[AgentServer]:
    with AgentServer((200, GOOD)) as running:
        yield running


def loaded(file, tmp_path):
    given = {"robot": "giraff", "credentials": file, "var": tmp_path, "adapter": "simulator"}
    return load(given, {})


def test_token_is_sent_in_the_body_and_the_answer_is_saved(server, tmp_path):
    file = tmp_path / "deep" / "giraff.toml"
    enrol("giraff", f"{server.url}/", "once", file)
    body = b'{"robot": "giraff", "token": "once"}'
    assert server.requests == [("/api/v1/agent/enrol/", "", body)]
    config = loaded(file, tmp_path)
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
def test_invalid_answer_is_reported_and_nothing_is_saved(server, tmp_path, code, content, words):
    server.answers = [(code, content)]
    with pytest.raises(ConfigError, match=words):
        enrol("giraff", server.url, "once", tmp_path / "giraff.toml")
    assert not list(tmp_path.iterdir())


def test_present_credentials_renew_themselves_and_are_kept_without_an_answer(server, tmp_path):
    file = tmp_path / "giraff.toml"
    file.write_text(f'robot = "giraff"\ntoken = "old"\nserver = "{server.url}"\n')
    config = loaded(file, tmp_path)
    server.answers = [(503, b""), (200, GOOD)]
    with pytest.raises(ServerAwayError):
        renew(config)
    assert 'token = "old"' in file.read_text()
    assert renew(config) == GOOD
    assert server.requests[-1] == ("/api/v1/agent/renew/", "Bearer giraff:old", b"{}")
    assert loaded(file, tmp_path).token == "fresh"


def test_missing_server_is_reported(tmp_path):
    with pytest.raises(ConfigError, match=r"the request to \S+ failed"):
        enrol("giraff", "http://127.0.0.1:9", "once", tmp_path / "giraff.toml")
