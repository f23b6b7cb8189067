"""The cache that several processes share: Redis, and while it is away the memory of this process.

What is cached are counts of attempts. Without Redis each process counts for itself, which lets a
few more through than the limit, and nobody is kept from logging in.
"""

import functools
import json
import time
from collections.abc import Callable
from typing import Any

import structlog
from django.core.cache.backends.locmem import LocMemCache
from django.core.cache.backends.redis import RedisCache
from redis.exceptions import RedisError

log = structlog.stdlib.get_logger(__name__)
ANSWER_SECONDS = 0.5  # for which Redis is waited for
AWAY_SECONDS = 5.0  # after which one that was away is asked again


def _or_memory(name: str) -> Callable[..., Any]:
    @functools.wraps(getattr(RedisCache, name))
    def call(self: "SharedCache", *args: Any, **options: Any) -> Any:
        if time.monotonic() >= self.asked_again_at:
            try:
                return getattr(RedisCache, name)(self, *args, **options)
            except (RedisError, OSError) as error:
                log.warning("cache_away", reason=type(error).__name__)
                SharedCache.asked_again_at = time.monotonic() + AWAY_SECONDS
        return getattr(self.memory, name)(*args, **options)

    return call


class JsonSerializer:
    """Values as JSON. With pickle, Django's own, everybody who can write to Redis runs code in the
    web processes.
    """

    def dumps(self, value: Any) -> int | bytes:
        """Return a value as Redis stores it; it counts with whole numbers itself."""
        return value if type(value) is int else json.dumps(value).encode()

    def loads(self, data: bytes) -> Any:
        """Return a stored value.

        Raises:
            ValueError: it is none of ours.
        """
        return json.loads(data)


class SharedCache(RedisCache):
    """Django's cache in Redis; while Redis is away its answers come from memory."""

    asked_again_at = 0.0  # of time.monotonic(); for the process, whose threads have a cache each

    def __init__(self, server: str, params: dict[str, Any]) -> None:
        waits = {"socket_timeout": ANSWER_SECONDS, "socket_connect_timeout": ANSWER_SECONDS}
        options = {"serializer": JsonSerializer, **waits, **params.get("OPTIONS", {})}
        # another version than that of the values that earlier releases have pickled
        super().__init__(server, {**params, "VERSION": 2, "OPTIONS": options})
        self.memory = LocMemCache("while-redis-is-away", {})

    add = _or_memory("add")
    get = _or_memory("get")
    set = _or_memory("set")
    touch = _or_memory("touch")
    delete = _or_memory("delete")
    has_key = _or_memory("has_key")
    incr = _or_memory("incr")
    get_many = _or_memory("get_many")
    set_many = _or_memory("set_many")
    delete_many = _or_memory("delete_many")
    clear = _or_memory("clear")
