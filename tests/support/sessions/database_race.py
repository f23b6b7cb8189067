"""A concurrent change of the database, just before a statement of the code under test."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from django.db import connection


@contextmanager
def just_before(statement: str, change: Callable[[], object], times: int = 1) -> Iterator[None]:
    """Run `change` before each of the first `times` statements that begin so ("UPDATE …")."""
    left, busy = times, False

    def wrapper(execute: Any, sql: str, params: Any, many: bool, context: Any) -> Any:
        nonlocal left, busy
        if left and not busy and sql.startswith(statement):
            left, busy = left - 1, True
            change()
            busy = False
        return execute(sql, params, many, context)

    with connection.execute_wrapper(wrapper):
        yield
    assert left == 0, f"{statement} was not run {times} times"
