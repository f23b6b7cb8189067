"""The server's processes as they are started: none of them loads the robot's side."""

import subprocess
import sys

import pytest

from tests.support.paths import ROOT

NOT_LOADED = "assert not [name for name in sys.modules if name.startswith('robots.agent')]"


@pytest.mark.parametrize(
    "loading",
    [
        "import telepresence_site.asgi",
        "import sessions.management.commands.run_session_manager",
        "import robots.management.commands.run_broker",
        "import django.urls; django.urls.get_resolver().url_patterns",
    ],
)
def test_the_server_loads_nothing_of_the_agent(loading):
    code = f"import django, sys; django.setup(); {loading}; {NOT_LOADED}"
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
