"""The demo seen by its driver while its parts are killed and others practise."""

import signal

import pytest

from tests.support.browsers.demo_visitors import demo_with_people

pytestmark = [pytest.mark.browser, pytest.mark.nightly]


def test_a_drive_goes_on_while_others_practise_and_all_servers_are_killed(tmp_path, browser):
    with demo_with_people(tmp_path / "var", browser) as people:
        people.ana_sets_out()
        for _ in range(2):
            people.cy_practises()
        people.ana_drives()
        for death in people.kill("practice supervisor", "broker", "web server", "session manager"):
            assert "SIGKILL" in death
            assert ".log)" in death
        people.ana_drives()
        assert people.demo.end(signal.SIGINT) == 0
