"""`python -m robots.simulator --profile giraff --plan office --seed 1`: a robot on a loopback
port.

Prints one line of JSON with its address on standard output when it is ready, and logs on standard
error.
"""

import argparse
import asyncio
import contextlib
import json
import logging
import math
import os
import signal
import sys
import threading
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from msgspec import structs

from robots.simulator.physics.simulation import Simulation, StartError
from robots.simulator.server import Server
from robots.world.robot_models import MODELS, RobotModel, UnknownProfileError, model_of
from robots.world.sites import SiteError, load_plan

if TYPE_CHECKING:
    from robots.simulator.render.camera import SceneCamera

MOST_PEOPLE = 12
MOST_FPS = 60.0
LOOPBACK = ("127.0.0.1", "localhost", "::1")


def parser() -> argparse.ArgumentParser:
    options = argparse.ArgumentParser(
        prog="python -m robots.simulator", description="A simulated robot on a loopback port."
    )
    options.add_argument("--profile", default="giraff", help=f"one of {', '.join(sorted(MODELS))}")
    options.add_argument(
        "--plan", default="office", help="a shipped site, or a folder with a plan.json"
    )
    options.add_argument("--seed", type=int, default=1, help="seed for everything random")
    options.add_argument(
        "--start", default="dock", help="dock, a start or place of the plan, or x,y,theta"
    )
    options.add_argument(
        "--charge", type=float, default=0.9, help="battery charge at the start, 0 to 1"
    )
    options.add_argument(
        "--people",
        type=int,
        default=0,
        help=f"number of people who walk about, at most {MOST_PEOPLE}",
    )
    options.add_argument(
        "--door-changes",
        type=float,
        default=0.0,
        help="average seconds between doors opening or closing by themselves; 0 for never",
    )
    options.add_argument(
        "--listen", default="127.0.0.1:0", help="loopback address and port; port 0 picks a free one"
    )
    options.add_argument(
        "--linger",
        type=float,
        help="seconds to run after the last driver leaves; without it, run until stopped",
    )
    options.add_argument(
        "--tied",
        action="store_true",
        help=(
            "stop waiting for a first driver when standard input closes: the "
            "parent process has ended"
        ),
    )
    options.add_argument("--no-camera", action="store_true", help="no pictures")
    options.add_argument("--sonar", action="store_true", help="add sonars to the laser")
    options.add_argument(
        "--fps", type=float, help="video frames per second, instead of the camera's own rate"
    )
    return options


def listen_address(text: str) -> tuple[str, int]:
    """Return host and port; ValueError unless it is loopback: clients are not authenticated."""
    host, _, port = text.rpartition(":")
    if host not in LOOPBACK or not port.isdigit():
        raise ValueError(f"--listen takes a loopback address such as 127.0.0.1:0, not {text!r}")
    return host, int(port)


def moving_things(people: int, door_changes: float) -> dict[str, Any]:
    """Return the arguments for people and doors; raises ValueError."""
    if not 0 <= people <= MOST_PEOPLE:
        raise ValueError(f"--people takes 0 to {MOST_PEOPLE}, not {people}")
    if not 0.0 <= door_changes < math.inf:
        raise ValueError(f"--door-changes takes seconds, or 0 for never, not {door_changes}")
    return {"people": people, "door_changes": door_changes}


def with_fps(model: RobotModel, fps: float | None) -> RobotModel:
    """Return the model with this frame rate, unless None; raises ValueError."""
    if fps is None:
        return model
    if not 0.0 < fps <= MOST_FPS:
        raise ValueError(f"--fps takes a number above 0 and up to {MOST_FPS:g}, not {fps}")
    return replace(model, camera=structs.replace(model.camera, fps=fps))


def announce(address: str) -> None:
    print(json.dumps({"address": address, "pid": os.getpid()}), flush=True)


def watch_input(loop: asyncio.AbstractEventLoop, server: Server) -> None:
    """Tell the server when stdin closes; in a thread, since Windows cannot poll a pipe."""

    def read() -> None:
        # not sys.stdin: its lock would be held when the interpreter ends
        while os.read(sys.stdin.fileno(), 64):
            pass
        with contextlib.suppress(RuntimeError):  # the loop has just ended
            loop.call_soon_threadsafe(server.orphaned)

    threading.Thread(target=read, name="input", daemon=True).start()


async def serve(server: Server, host: str, port: int, *, tied: bool) -> None:
    """Run until a signal, or until the server is done."""
    loop = asyncio.get_running_loop()
    if tied:
        watch_input(loop, server)
    for number in (signal.SIGINT, signal.SIGTERM):
        try:
            loop.add_signal_handler(number, server.end)
        except NotImplementedError:  # Windows: its Ctrl-C arrives as KeyboardInterrupt
            break
    await server.run(host, port, announce)


def server_of(words: argparse.Namespace) -> Server:
    """Return the server of the simulation that the arguments describe. Raises UnknownProfileError,
    SiteError, StartError or ValueError.
    """
    model = with_fps(model_of(words.profile), words.fps)
    plan, _ = load_plan(words.plan)
    simulation = Simulation(
        model,
        plan,
        seed=words.seed,
        start=words.start,
        charge=words.charge,
        **moving_things(words.people, words.door_changes),
    )

    def renderer() -> "SceneCamera":
        # Its import takes seconds, of which --help needs none.
        from robots.simulator.render.camera import SceneCamera  # noqa: PLC0415

        return SceneCamera(model, plan, seed=words.seed)

    return Server(
        simulation,
        None if words.no_camera else renderer,
        linger=words.linger,
        seed=words.seed,
        sonar=words.sonar,
    )


def main(arguments: list[str] | None = None) -> int:
    """Run a simulated robot; return 2, with one sentence, when it cannot be built."""
    words = parser().parse_args(arguments)
    logging.basicConfig(
        level=logging.WARNING,
        stream=sys.stderr,
        format="simulator %(levelname)s %(name)s %(message)s",
    )
    try:
        host, port = listen_address(words.listen)
        server = server_of(words)
    except (UnknownProfileError, SiteError, StartError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    try:
        asyncio.run(serve(server, host, port, tied=words.tied))
    except KeyboardInterrupt:
        return 0
    except OSError as error:
        print(f"cannot listen on {words.listen}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
