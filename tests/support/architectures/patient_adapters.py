"""Longer time limits of adapters, for tests on a busy machine."""

import dataclasses

import pytest

from robots.agent.adapters.common import remote_adapter
from robots.agent.adapters.navigation_layer import adapter as autonomy, child
from robots.agent.adapters.simulator import adapter as simulator
from tests.support.patience import patient

SECONDS = (
    (simulator, ("SILENCE", "FRESH")),
    (remote_adapter, ("SILENCE", "CONNECT_TIME", "FIRST_READING")),
    (autonomy, ("STUCK", "STUCK_IDLE")),
    (child, ("READY_TIME", "ANSWER_TIME")),
)


def make_patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let adapters wait longer for a silent robot, because a busy computer may delay its readings.
    tests/timing tests the real limits.
    """
    for module, names in SECONDS:
        for name in names:
            monkeypatch.setattr(module, name, patient(getattr(module, name)))
    gate = remote_adapter.GATE
    slower = {
        name: patient(getattr(gate, name)) for name in ("patience", "oldest", "freshest", "longest")
    }
    monkeypatch.setattr(remote_adapter, "GATE", dataclasses.replace(gate, **slower))
