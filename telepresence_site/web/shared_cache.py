"""The cache of several processes: Redis, and while Redis is away the memory of this process.

It has counts of attempts. Without Redis each process counts for itself, which allows a few more
than the limit, and still lets users log in.
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
ANSWER_SECONDS = 0.5  # the time limit of Redis
AWAY_SECONDS = 5.0  # after a failure, until Redis is tried again


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
    """Values as JSON. With pickle, Django's default, everyone who can write to Redis could run code
    in the web processes.
    """

    def dumps(self, value: Any) -> int | bytes:
        """Return a value for Redis, which increments whole numbers itself."""
        return value if type(value) is int else json.dumps(value).encode()

    def loads(self, data: bytes) -> Any:
        """Return a stored value, or raise ValueError."""
        return json.loads(data)


class SharedCache(RedisCache):
    asked_again_at = 0.0  # of time.monotonic(); for the process, whose threads have a cache each

    def __init__(self, server: str, params: dict[str, Any]) -> None:
        waits = {"socket_timeout": ANSWER_SECONDS, "socket_connect_timeout": ANSWER_SECONDS}
        options = {"serializer": JsonSerializer, **waits, **params.get("OPTIONS", {})}
        # version 1 has values that earlier releases pickled
        super().__init__(server, {**params, "VERSION": 2, "OPTIONS": options})
        self.memory = LocMemCache("while-redis-is-away", {})

    add, get, set, touch, delete = map(_or_memory, ("add", "get", "set", "touch", "delete"))
    has_key, incr, clear = map(_or_memory, ("has_key", "incr", "clear"))
    get_many, set_many, delete_many = map(_or_memory, ("get_many", "set_many", "delete_many"))
