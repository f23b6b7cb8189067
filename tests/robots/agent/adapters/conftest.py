"""Adapters that wait as long as a busy machine takes."""

import pytest

from robots.agent.adapters import remote, simulator
from tests.support.patience import patient


@pytest.fixture
def patient_adapters(monkeypatch):
    """A robot that says nothing for a second is given up. Here that second may be the machine's, which has others to serve."""
    monkeypatch.setattr(simulator, "SILENCE", patient(simulator.SILENCE))
    for name in ("SILENCE", "CONNECT_TIME", "FIRST_READING"):
        monkeypatch.setattr(remote, name, patient(getattr(remote, name)))
