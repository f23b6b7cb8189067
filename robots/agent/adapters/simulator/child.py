"""The simulated robot's process as a child of the agent, which outlives no agent."""

import json
import subprocess
import threading
from collections.abc import Mapping
from typing import Any

from robots.agent.adapters.common.child_process import start_module
from robots.agent.robot_interface import AdapterError
from robots.process.ending import wait_or_kill

START_TIME = 20.0
END_TIME = 3.0
LINGER = 2.0


def launch(series: str, options: Mapping[str, Any]) -> tuple[subprocess.Popen[bytes], str]:
    """Start a simulator and wait for its address; blocks. Raises AdapterError."""
    linger = str(options.get("linger", LINGER))
    command = ["robots.simulator", "--profile", series, "--tied", "--linger", linger]
    command += [
        f"--{name}={options[name]}"
        for name in ("plan", "seed", "start", "charge", "people", "door-changes", "fps")
        if name in options
    ]
    if str(options.get("camera", "yes")) == "no":
        command.append("--no-camera")
    if "sonar" in str(options.get("sensors", "")):
        command.append("--sonar")
    child = start_module(*command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    stuck = threading.Timer(START_TIME, child.kill)
    stuck.start()
    try:
        line = child.stdout.readline() if child.stdout else b""
    finally:
        stuck.cancel()
    if not line:
        child.kill()
        raise AdapterError(f"the simulator did not start: exit status {child.wait()}")
    return child, str(json.loads(line)["address"])


def end(child: subprocess.Popen[bytes]) -> None:
    """Wait for a simulator that is ending, and kill it if it does not end."""
    wait_or_kill(child, END_TIME)
    for pipe in (child.stdin, child.stdout):
        if pipe is not None:
            pipe.close()
