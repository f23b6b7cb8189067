"""A process that does what it is asked by name: a JSON list of a method and its arguments a line,
one JSON answer a line.
"""

import asyncio
import gc
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

ROOT = Path(__file__).resolve().parents[2]


class Hands:
    """The asker's side: `hands.ask("online")`. Use as a context manager."""

    def __init__(self, module: str) -> None:
        environment = os.environ | {"PYTHONUNBUFFERED": "1"}
        self._process = subprocess.Popen(
            [sys.executable, "-m", module],
            cwd=ROOT,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.pid = self._process.pid

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self._process.kill()
        self._process.communicate()

    def ask(self, what: str, *arguments: Any) -> Any:
        """Have a method called and return its answer.

        Raises:
            RuntimeError: the process is gone.
        """
        assert self._process.stdin, "a pipe was asked for"
        assert self._process.stdout, "a pipe was asked for"
        self._process.stdin.write(json.dumps([what, *arguments]) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"{what}: the process is gone")
        return json.loads(line)


def serve(make: Callable[[], Any]) -> None:
    """Answer until the input ends."""
    asyncio.run(_serve(make))


async def _serve(make: Callable[[], Any]) -> None:
    asked = asyncio.StreamReader(limit=1 << 24)
    await asyncio.get_running_loop().connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(asked), sys.stdin
    )
    does = make()
    gc.freeze()  # a collection of everything that was imported would hold the loop up
    while line := await asked.readline():
        what, *arguments = json.loads(line)
        answer = getattr(does, what)(*arguments)
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()
