"""The server's processes as they are started: none of them loads the robot's side, or what takes
long to load and is needed by few requests.
"""

import subprocess
import sys

import pytest

from tests.support.paths import ROOT

NOT_LOADED = ("robots.agent", "matplotlib", "scipy.stats", "scipy.optimize")
CHECK = (
    f"loaded = [name for name in {NOT_LOADED} if name in sys.modules]; assert not loaded, loaded"
)


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
    code = f"import django, sys; django.setup(); {loading}; {CHECK}"
    ran = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        env={"DJANGO_SETTINGS_MODULE": "tests.settings", "PATH": "/usr/bin"},
    )
    assert ran.returncode == 0, ran.stderr
