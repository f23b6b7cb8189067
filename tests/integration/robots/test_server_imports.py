"""No process of the server loads the robot's code, or slow packages that few requests need; a
robot's process loads no package that only sites install, for analysis.
"""

import sys

import pytest

from tests.support.programs.finished import run

ANALYSIS = ("krippendorff", "matplotlib", "pandas", "pyreadstat", "statsmodels")
ENVIRONMENT = {"DJANGO_SETTINGS_MODULE": "tests.settings", "PATH": "/usr/bin"}
NOT_LOADED = ("robots.agent", "scipy.stats", "scipy.optimize", *ANALYSIS)


def loads(code, unwanted):
    """Run `code` in a process; return its errors, or which of the `unwanted` modules it loaded."""
    check = f"loaded = [m for m in {unwanted} if m in sys.modules]; assert not loaded, loaded"
    code = f"import django, sys; django.setup(); {code}; {check}"
    ran = run(sys.executable, "-c", code, env=ENVIRONMENT)
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
def test_server_loads_neither_the_agent_nor_slow_packages(loading):
    assert not loads(loading, NOT_LOADED)


def test_robots_process_loads_no_package_for_analysis():
    agent = "import robots.management.commands.run_robot, robots.agent.agent"
    assert not loads(agent, ANALYSIS)
