"""The threads in which pages ask the database.

asgiref would run the queries of all pages in one thread: a slow one would keep all other pages
waiting. Like queries of several processes, those of several pages overlap; those of one page do not
where the page takes its `turn`.
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
    """Return what `question` returns, in one of the threads, with a connection that works.

    Raises:
        DatabaseError: or InterfaceError, as the question did.
    """
    ask: Any = DatabaseSyncToAsync(question, thread_sensitive=False, executor=_POOL)
    answer: Answer = await ask(*args, **kwargs)
    return answer
