"""`python -m benchmarks.traffic.based_robot NAME --mqtt URL --token TOKEN --var DIR --base PORT`: a
real agent whose base is in another process.

Agent, safety kernel, media and connection are the project's own; the base is simulated and the
camera's image drawn. Each velocity that the kernel sends is one datagram to the simulated base,
which therefore knows what moved and when even if the agent is killed.
"""

import argparse
import os
import socket
import sys
from dataclasses import replace

from robots.agent.agent import Agent, run_until_signalled
from robots.agent.config import load
from robots.api.messages import Velocity
from tests.support.agents.scripted_robot import ScriptedRobot
from tests.support.media.synthetic_camera import SyntheticCamera

FPS = 5.0  # enough to tell for how long there was no picture


class BasedRobot(ScriptedRobot):
    """Sends each velocity to the simulated base of another process."""

    def __init__(self, name: str, port: int) -> None:
        super().__init__()
        self._name = name
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))

    def video(self) -> SyntheticCamera:
        """Return the camera, which captures while it has viewers."""
        return SyntheticCamera(FPS)

    def apply(self, velocity: Velocity) -> Velocity:
        self._socket.send(f"{self._name} {velocity.linear} {velocity.angular}".encode())
        self.reading = replace(self.reading, velocity=velocity)
        return velocity


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("robot")
    for name in ("--mqtt", "--token", "--var", "--base"):
        parser.add_argument(name, required=True)
    given = parser.parse_args()
    environment = {**os.environ, "TELEPRESENCE_TOKEN": given.token}
    config = load({"robot": given.robot, "mqtt_url": given.mqtt, "var": given.var}, environment)
    run_until_signalled(
        Agent(config, make_adapter=lambda _: BasedRobot(given.robot, int(given.base)))
    )


if __name__ == "__main__":
    sys.exit(main())
