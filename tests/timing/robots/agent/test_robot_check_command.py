"""`run_robot NAME --check` as its owner runs it: on the simulated robot, on one of ROS 1, and
interrupted.
"""

import asyncio
import signal
import subprocess
import sys
import time

import pytest

from robots.agent.config import ConfigError
from robots.agent.control.robot_check import RobotCheck, check_robot
from tests.support.architectures.ros1_robot import Ros1Rig
from tests.support.paths import ROOT
from tests.support.patience import patient

AGENT = [sys.executable, "-m", "robots.agent", "giraff", "--check", "--adapter", "simulator"]


def test_the_simulated_robot_passes_and_the_process_says_so(tmp_path):
    command = [
        sys.executable,
        "manage.py",
        "run_robot",
        "giraff",
        "--check",
        "--yes",
        "--adapter",
        "simulator",
        "--var",
        str(tmp_path),
    ]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=patient(60.0)
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "it keeps the watchdog of 0.3 s" in done.stdout
    assert "Laser: yes." in done.stdout
    assert "Camera: 640 x 480." in done.stdout


def test_without_a_yes_nothing_moves(tmp_path):
    done = subprocess.run(
        [*AGENT, "--var", str(tmp_path)],
        cwd=ROOT,
        input="no\n",
        capture_output=True,
        text=True,
        check=False,
        timeout=patient(30.0),
    )
    assert done.returncode == 1
    assert "The robot was not moved" in done.stderr
    assert "Driving" not in done.stdout


def test_a_robot_whose_kind_is_not_told_is_not_tried(tmp_path):
    with pytest.raises(ConfigError, match="add --adapter"):
        check_robot({"robot": "giraff", "var": tmp_path}, print)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_though_it_was_started_with_signals_ignored(tmp_path, number):
    child = subprocess.Popen(
        [*AGENT, "--yes", "--var", str(tmp_path)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    )
    try:
        assert any("Driving" in line for line in child.stdout)
        child.send_signal(number)
        began = time.monotonic()
        _, told = child.communicate(timeout=patient(15.0))
        assert child.returncode == 1
        assert "Stopped at your request" in told
        assert time.monotonic() - began < patient(6.0)
    finally:
        child.kill()
        child.wait()


def test_a_robot_of_ros_1_is_tried_through_its_own_adapter():
    with Ros1Rig() as rig:
        lines = []

        async def tried():
            adapter = rig.adapter()
            return adapter.profile.navigation_control, await RobotCheck(
                adapter, lines.append, video=adapter.video()
            ).run()

        stated, is_well = asyncio.run(tried())
        assert is_well is (stated is not None), lines
        assert any("it keeps the watchdog of 0.6 s" in line for line in lines)
        found = "guarded" if stated == "guarded" else "unguarded"
        assert any(f"Navigation is {found}: " in line for line in lines), lines
        moved = [linear for _, linear, _ in rig.world.commands]
        assert moved[-1] == 0.0
