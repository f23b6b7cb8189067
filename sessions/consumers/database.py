"""The threads for the database queries of pages.

asgiref would run the queries of all pages in one thread, where a slow one delays all other pages.
Here the queries of several pages overlap, as those of several processes do; those of one page do
not if it holds its `turn`.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ParamSpec, TypeVar

from channels.db import DatabaseSyncToAsync

Parameters = ParamSpec("Parameters")
Answer = TypeVar("Answer")

_POOL = ThreadPoolExecutor(4, "page-database")


async def query(
    question: Callable[Parameters, Answer], *args: Parameters.args, **kwargs: Parameters.kwargs
) -> Answer:
    """Call `question` in one of the threads, with a working connection, and return its result.

    Raises:
        DatabaseError: or InterfaceError, from `question`.
    """
    ask: Any = DatabaseSyncToAsync(question, thread_sensitive=False, executor=_POOL)
    answer: Answer = await ask(*args, **kwargs)
    return answer
