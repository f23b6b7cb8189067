"""Child processes of an adapter: modules of ours, and nodes that run in the Python of ROS."""

import asyncio
import contextlib
import hmac
import os
import secrets
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

LONGEST_LINE = 8 << 20  # bytes that a child may send as one line
POLL_INTERVAL_S = 0.2  # between two checks that a starting child is alive

Connection = tuple[asyncio.StreamReader, asyncio.StreamWriter]


def start(
    command: Sequence[str], environment: Mapping[str, str], **pipes: Any
) -> subprocess.Popen[bytes]:
    """Start a child outside the terminal's process group: on Ctrl-C the agent brakes before it ends
    the child. Raises OSError.
    """
    return subprocess.Popen(
        command,
        start_new_session=True,
        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        env=environment,
        **pipes,
    )


def start_module(*command: str, **pipes: Any) -> subprocess.Popen[bytes]:
    """Start `python -m` with this command, in milliseconds; raises OSError."""
    # One thread for linear algebra: the matrices are small, and idle threads would spin beside the
    # agent.
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    # the folder of `robots`, so that the child can import it
    folder = str(Path(__file__).resolve().parents[4])
    return start([sys.executable, "-m", *command], environment, cwd=folder, **pipes)


def send_token(child: subprocess.Popen[bytes], token: str) -> None:
    """Write the token of `connect_child` as the only line of a child's standard input."""
    assert child.stdin is not None
    with contextlib.suppress(BrokenPipeError):  # it has ended, which `connect_child` notices
        child.stdin.write(f"{token}\n".encode())
        child.stdin.close()


async def connect_child(
    launch: Callable[[int, str], subprocess.Popen[bytes]], within: float
) -> Connection:
    """Start a child and return the connection that it opens to this process.

    Args:
        launch: starts the child, in a thread, with a port of 127.0.0.1 and a token. The token is
            the first line that the child sends there, so that no other process takes its place.
        within: seconds that the child may take to connect.

    Raises:
        OSError: it ended before it connected; or what `launch` raises.
        TimeoutError: it did not connect in time.
    """
    token = secrets.token_hex(16)
    connected: asyncio.Future[Connection] = asyncio.get_running_loop().create_future()

    async def greet(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError, ValueError):  # ValueError: the line is too long
            line = (await reader.readline()).strip()
            if hmac.compare_digest(line, token.encode()) and not connected.done():
                connected.set_result((reader, writer))
                return
        writer.close()

    server = await asyncio.start_server(greet, "127.0.0.1", 0, limit=LONGEST_LINE)
    try:
        child = await asyncio.to_thread(launch, server.sockets[0].getsockname()[1], token)
        status = None
        async with asyncio.timeout(within):
            while not connected.done():
                if status is not None:
                    raise OSError(f"it ended at once, with exit status {status}")
                status = child.poll()  # one that has ended may have sent its reason just before
                await asyncio.wait({connected}, timeout=POLL_INTERVAL_S)
        return connected.result()
    finally:
        server.close()
