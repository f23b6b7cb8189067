"""`manage.py run_session_manager`: how it ends."""

import os
import signal

import pytest
from django.core.management import CommandError, call_command

from sessions.management.commands import run_session_manager as module
from sessions.manager.active import RecorderDied
from sessions.manager.service import SessionManager


@pytest.fixture(autouse=True)
def unchanged_interpreter(monkeypatch):
    monkeypatch.setattr(module, "set_up_for_latency", lambda: None)


def run():
    call_command("run_session_manager", skip_checks=True)


@pytest.mark.parametrize("url", ["http://127.0.0.1", "mqtt://", "mqtt://127.0.0.1:port"])
def test_an_address_that_no_broker_has_is_one_sentence(settings, url):
    settings.MQTT_URL = url
    with pytest.raises(CommandError, match="The broker's address “"):
        run()


def test_a_recorder_that_died_ends_the_process_for_its_supervisor(monkeypatch):
    async def dies(_manager):
        raise RecorderDied

    monkeypatch.setattr(SessionManager, "run", dies)
    with pytest.raises(CommandError, match="Start the session manager again"):
        run()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_is_ended_properly_by_a_signal(monkeypatch, number):
    ended = []

    async def runs(manager):
        os.kill(os.getpid(), number)
        await manager._stopping.wait()
        ended.append(number)

    monkeypatch.setattr(SessionManager, "run", runs)
    run()
    assert ended == [number]
