"""The server's processes as they are started: none of them loads the robot's side, or what takes
long to load and is needed by few requests. A robot's process loads nothing that is installed for
analysis at sites alone.
"""

import subprocess
import sys

import pytest

from tests.support.paths import ROOT

ANALYSIS = ("krippendorff", "matplotlib", "pandas", "pyreadstat", "statsmodels")
NOT_LOADED = ("robots.agent", "scipy.stats", "scipy.optimize", *ANALYSIS)


def loads(code, unwanted):
    """Run `code` in a process of its own, and return its errors, or which modules it loaded of
    `unwanted`.
    """
    check = f"loaded = [m for m in {unwanted} if m in sys.modules]; assert not loaded, loaded"
    ran = subprocess.run(
        [sys.executable, "-c", f"import django, sys; django.setup(); {code}; {check}"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        env={"DJANGO_SETTINGS_MODULE": "tests.settings", "PATH": "/usr/bin"},
    )
    return "" if ran.returncode == 0 else ran.stderr


@pytest.mark.parametrize(
    "loading",
    [
        "import telepresence_site.asgi",
        "import sessions.management.commands.run_session_manager",
        "import robots.management.commands.run_broker",
        "import django.urls; django.urls.get_resolver().url_patterns",
    ],
)
def test_the_server_loads_neither_the_agent_nor_what_is_slow(loading):
    assert not loads(loading, NOT_LOADED)


def test_a_robots_process_loads_no_package_that_is_for_analysis():
    agent = "import robots.management.commands.run_robot, robots.agent.agent"
    assert not loads(agent, ANALYSIS)
