"""Parts that end are named and restarted: real processes, with delays of 0 s."""

import contextlib
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from telepresence_site.children import NOTICE_PREFIX, Child, Children
from telepresence_site.demo.supervision import (
    DemoPart,
    PartLostError,
    RestartPolicy,
    ServiceSupervisor,
)
from tests.support.sessions.site import wait_for

POLICY = RestartPolicy(first_delay=0.0, longest_delay=0.0, settled=1000.0, quick_deaths=3)
LIVE = ["-c", "import time; print('ready', flush=True); time.sleep(600)"]
DIES = ["-c", "print('the port is taken', flush=True); raise SystemExit(1)"]


def says_ready(child: Child) -> bool:
    return "ready" in child.output()


@pytest.fixture
def children(tmp_path: Path) -> Iterator[Children]:
    family = Children(tmp_path / "log", dict(os.environ))
    yield family
    family.stop()


@pytest.fixture
def sentences() -> list[str]:
    return []


@pytest.fixture
def supervisor(children, sentences) -> ServiceSupervisor:
    return ServiceSupervisor(children, sentences.append, POLICY)


def start(supervisor: ServiceSupervisor, *parts: DemoPart, within: float = 60.0) -> None:
    supervisor.start(parts, within=within, step=lambda _name: contextlib.nullcontext())


def look_until(supervisor: ServiceSupervisor, condition: Callable[[], object]) -> None:
    def looked() -> object:
        supervisor.look()
        return condition()

    wait_for(looked, 20, "what the supervisor is to do")


def kill(child: Child) -> None:
    child.process.kill()
    child.process.wait()


@pytest.mark.parametrize("is_essential", [True, False], ids=["essential", "not essential"])
def test_killed_part_is_named_with_its_log_and_again_after_its_restart(
    children, supervisor, sentences, is_essential
):
    start(supervisor, DemoPart("broker", LIVE, says_ready, is_essential))
    for _ in range(2):
        first = children.running[0]
        kill(first)
        sentences.clear()
        look_until(supervisor, lambda: len(sentences) == 2)
        ended = f"The broker ended: it was ended by SIGKILL (its log: {first.log})."
        assert sentences[0] == f"{ended} Starting it again in 0 s."
        assert sentences[1].startswith("The broker is back after ")
        assert [child.process.poll() for child in children.running] == [None]
        assert children.running[0] is not first


def test_messages_of_a_parts_children_are_printed_once(supervisor, sentences):
    lines = (
        f"{NOTICE_PREFIX}The practice robot ended.",
        "2026 not for people",
        f"{NOTICE_PREFIX}One é more.",
    )
    script = f"import time; print({chr(10).join(lines)!r}, flush=True); time.sleep(600)"
    start(supervisor, DemoPart("practice", ["-c", script], lambda _child: True, has_notices=True))
    look_until(supervisor, lambda: len(sentences) > 1)
    supervisor.look()
    assert sentences == ["The practice robot ended.", "One é more."]


def test_part_whose_log_cannot_be_written_is_tried_again_until_it_can(
    children, supervisor, sentences, tmp_path
):
    start(supervisor, DemoPart("robot", LIVE, says_ready))
    kill(children.running[0])
    log = tmp_path / "log" / "robot.log"
    log.unlink()
    log.mkdir()
    look_until(supervisor, lambda: len(sentences) > 3)
    assert sentences[0].startswith("The robot ended: it was ended by SIGKILL")
    assert (
        sentences[1] == "The robot could not be started: Is a directory. Starting it again in 0 s."
    )
    log.rmdir()
    look_until(supervisor, lambda: "The robot is back after" in sentences[-1])


def test_essential_part_that_keeps_failing_is_lost_with_its_own_reason(supervisor, sentences):
    with pytest.raises(
        PartLostError,
        match=r"The broker ended: the port is taken \(its log: .*\)\. It ended 3 times in a row",
    ):
        start(supervisor, DemoPart("broker", DIES, lambda _child: False, is_essential=True))
    assert len(sentences) == 2


def test_failing_robot_does_not_delay_the_others_and_is_tried_again(
    children, supervisor, sentences, tmp_path
):
    repaired = tmp_path / "repaired"
    robot = [
        "-c",
        f"import pathlib, sys, time\nif not pathlib.Path({str(repaired)!r}).exists(): sys.exit('no"
        " such site')\n" + LIVE[1],
    ]
    start(
        supervisor,
        DemoPart("robot", robot, says_ready),
        DemoPart("web server", LIVE, says_ready, is_essential=True),
        within=2.0,
    )
    assert any("is not ready yet: " in one and "Continuing without it" in one for one in sentences)
    look_until(supervisor, lambda: sum("no such site" in one for one in sentences) > 6)
    repaired.touch()
    look_until(supervisor, lambda: "The robot is back after" in sentences[-1])
    assert {child.name for child in children.running} == {"robot", "web server"}


def test_essential_part_that_is_never_ready_is_named(supervisor):
    web = DemoPart("web server", LIVE, lambda _child: False, is_essential=True)
    with pytest.raises(PartLostError, match="The web server is not ready yet: ready"):
        start(supervisor, web, within=1.0)


def test_part_that_dies_during_the_start_of_another_is_restarted(
    children, supervisor, sentences, tmp_path
):
    second = tmp_path / "second"
    once = [
        "-c",
        f"import pathlib, sys\nmark = pathlib.Path({str(second)!r})\nif not mark.exists():"
        " mark.touch(); sys.exit('not yet')\n" + LIVE[1],
    ]
    start(
        supervisor,
        DemoPart("broker", LIVE, lambda _child: second.exists(), is_essential=True),
        DemoPart("manager", once, says_ready, is_essential=True),
    )
    assert "The manager ended: not yet" in sentences[0]
    assert all(child.process.poll() is None for child in children.running)


def test_log_separates_the_lines_of_a_killed_part_from_those_of_the_next(
    children,
):
    first = children.start("broker", ["-c", "print('ready', flush=True); raise SystemExit(1)"])
    first.process.wait()
    children.end(first)
    second = children.start("broker", ["-c", ""])
    second.process.wait()
    assert (first.last_line(), second.last_line()) == ("ready", "it said nothing")
    assert second.log.read_text() == "ready\n"


def test_child_receives_ctrl_c_although_its_parent_was_started_ignoring_it(children):
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        child = children.start("python", LIVE)
    finally:
        signal.signal(signal.SIGINT, before)
    wait_for(lambda: says_ready(child), 20, "a child that runs")
    child.process.send_signal(signal.SIGINT)
    assert child.process.wait(20) != 0
