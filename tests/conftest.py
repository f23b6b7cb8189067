"""Fixtures of every test, and which tests need the computer for themselves."""

import os
import sys
from pathlib import Path

import pytest
from django.core.cache import cache
from django.utils import translation
from hypothesis import HealthCheck, settings

HERE = Path(__file__).parent
# Real browsers, brokers, processes and safety bounds: what is measured in them is time, which a neighbour would take. All other tests compute.
ALONE = (
    "browser", "experiments/bots/test_pace.py", "experiments/test_task_live.py", "robots/agent/adapters/test_whole_agent.py",
    "robots/agent/media", "robots/agent/test_agent.py", "robots/agent/test_autonomous_drive.py",
    "robots/agent/test_blocked_loop.py", "timing", "sessions/test_session_manager.py",
    "site/test_adapters.py", "site/test_bots.py", "site/test_demo.py", "site/test_rehearsing.py", "site/test_server.py",
)  # fmt: skip
# Of those folders, what shows pages or computes and drives no robot.
BESIDE = (
    "browser/test_accessibility.py", "browser/test_course_builder.py", "browser/test_questions.py", "browser/test_replay.py", "browser/test_robot_list.py",
    "robots/agent/media/test_climb.py", "robots/agent/media/test_frame_gate.py", "robots/agent/media/test_rtp.py", "robots/agent/media/test_sctp.py",
    "robots/agent/media/test_sdp.py", "robots/agent/media/test_telemetry.py", "robots/agent/media/test_viewer.py",
    "robots/agent/media/test_viewer_queue.py",
)  # fmt: skip
# What takes longest begins first, so that no core waits at the end for another.
LONG = (
    "sessions/test_lease_races.py", "robots/agent/test_safety_properties.py", "experiments/test_assignment_races.py",
    "robots/agent/navigation/test_docking.py", "experiments/test_export.py", "site/test_static_files.py",
)  # fmt: skip

# A busy computer is slow at everything: an example that takes long is no finding. The same examples every time, so that a change is judged by
# what it changes; `pytest --hypothesis-profile=search` looks for others.
settings.register_profile("search", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("same", settings.get_profile("search"), derandomize=True)
settings.load_profile("same")


@pytest.fixture(autouse=True)
def no_attempts_counted():
    """How often an address has tried something stands in the process's cache, and all tests of a process come from one address."""
    cache.clear()


@pytest.fixture(autouse=True)
def language_of_nobody():
    """A request in another language leaves it behind in its thread, which is the tests' own."""
    yield
    translation.deactivate()


@pytest.hookimpl(trylast=True)
def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Say at once what failed: a run that somebody ends would otherwise keep it to itself. Of several processes, the one that collects says it."""
    if report.failed and "PYTEST_XDIST_WORKER" not in os.environ:
        sys.stderr.write(f"\n{report.nodeid} ({report.when}) failed:\n{report.longreprtext[-2000:]}\n")
        sys.stderr.flush()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what must not run beside other tests: `-m alone`, and `-n 2 -m "not alone"` for the others. Put the longest files first."""
    beside, long = {HERE / name for name in BESIDE}, [HERE / name for name in LONG]
    items.sort(key=lambda item: long.index(item.path) if item.path in long else len(long))
    alone = {HERE / name for name in ALONE}
    missing = [path for path in (*alone, *beside, *long) if not path.exists()]
    assert not missing, f"there is no {missing}"
    for item in items:
        if item.path not in beside and alone & {item.path, *item.path.parents}:
            item.add_marker("alone")
