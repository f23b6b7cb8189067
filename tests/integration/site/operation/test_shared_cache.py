"""Attempts are counted and users log in also without Redis."""

import os
import pickle
import subprocess
from pathlib import Path

import pytest
from django.core.cache import cache
from django.urls import reverse
from redis import Redis
from redis.exceptions import AuthenticationError, ConnectionError as RedisConnectionError

from accounts.attempts import Attempts
from accounts.models import User
from telepresence_site.web import shared_cache
from telepresence_site.web.shared_cache import SharedCache
from tests.support.agents.simulators import eventually
from tests.support.programs.deployed import compose, pods
from tests.support.sessions.site import free_port

NOW = 1_800_000_000.0


@pytest.fixture
def redis(tmp_path, settings, monkeypatch):
    """A Redis as the cache of this process; yields functions to start and kill it."""
    port = free_port()
    running: list[subprocess.Popen] = []

    def start():
        words = ["redis-server", "--port", str(port), "--bind", "127.0.0.1", "--save", ""]
        running.append(subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.DEVNULL))

    def kill():
        running[-1].kill()
        running[-1].wait()

    monkeypatch.setattr(shared_cache, "AWAY_SECONDS", 0.0)
    monkeypatch.setattr(SharedCache, "asked_again_at", 0.0)
    backend = "telepresence_site.web.shared_cache.SharedCache"
    settings.CACHES = {"default": {"BACKEND": backend, "LOCATION": f"redis://127.0.0.1:{port}"}}
    start()
    yield start, kill
    kill()
    cache.clear()


def is_shared() -> bool:
    """Tell whether Redis itself answers."""
    cache.set("probe", "redis")
    cache.memory.delete("probe")
    return cache.get("probe") == "redis"


def allowed(attempts: Attempts, times: int) -> list[bool]:
    return [attempts.count("192.0.2.7", NOW) for _ in range(times)]


def test_attempts_are_limited_with_redis_without_it_and_with_it_again(redis, caplog):
    start, kill = redis
    attempts = Attempts("test_of_the_cache", limit=3)
    assert eventually(is_shared)
    assert allowed(attempts, 4) == [True, True, True, False]
    kill()
    assert allowed(attempts, 4) == [True, True, True, False]
    assert "cache_away" in caplog.text
    start()
    assert eventually(is_shared)
    assert allowed(attempts, 4) == [True, True, True, False]  # Redis has lost its data


@pytest.mark.django_db
def test_users_log_in_while_redis_is_unavailable(redis, client):
    _start, kill = redis
    assert eventually(is_shared)
    kill()
    User.objects.create_user("ada", password="a long password")
    answer = client.post(reverse("account_login"), {"login": "ada", "password": "a long password"})
    assert answer.status_code == 302
    assert answer.headers["Location"] == reverse("home")


def test_foreign_data_in_redis_run_no_code(redis, tmp_path):
    assert eventually(is_shared)

    class Evil:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "ran",))

    client = cache._cache.get_client()
    client.set(cache.make_key("evil"), pickle.dumps(Evil()))
    with pytest.raises(ValueError, match=r"codec can't decode|Expecting value"):
        cache.get("evil")
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("place", ["compose", "kubernetes"])
def test_redis_in_a_container_answers_only_with_its_password(place, tmp_path):
    if place == "compose":
        service = compose("compose.yaml")["redis"].around
        line, variable = service["command"][-1].replace("$$", "$"), "REDISCLI_AUTH"
        assert service["environment"] == {variable: "${REDIS_PASSWORD:?}"}
        url = compose("compose.yaml")["web-1"].around["environment"]["REDIS_URL"]
        assert url == "redis://:${REDIS_PASSWORD:?}@redis:6379/0"
    else:
        (container,) = pods("one")["redis"]["containers"]
        line, variable = container["command"][-1], "REDIS_PASSWORD"
    port = free_port()
    line = line.replace("/tmp/redis.conf", str(tmp_path / "redis.conf"))
    with subprocess.Popen(
        ["sh", "-c", f"{line} --port {port} --bind 127.0.0.1"],
        env={"PATH": os.environ["PATH"], variable: "deadbeef"},
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
    ) as server:
        try:
            assert eventually(lambda: answers(f"redis://:deadbeef@127.0.0.1:{port}/0"))
            for url in (f"redis://127.0.0.1:{port}/0", f"redis://:wrong@127.0.0.1:{port}/0"):
                with pytest.raises(AuthenticationError):
                    Redis.from_url(url).ping()
            assert (tmp_path / "redis.conf").stat().st_mode & 0o077 == 0
            assert "deadbeef" not in Path(f"/proc/{server.pid}/cmdline").read_text()
        finally:
            server.terminate()


def answers(url: str) -> bool:
    try:
        return bool(Redis.from_url(url).ping())
    except (ConnectionError, RedisConnectionError):
        return False
