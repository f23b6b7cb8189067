"""Adapters that wait as long as a busy machine takes."""

import pytest

from robots.agent.adapters import autonomy, autonomy_child, remote, simulator
from tests.support.patience import patient

SECONDS = (
    (simulator, ("SILENCE",)),
    (remote, ("SILENCE", "CONNECT_TIME", "FIRST_READING")),
    (autonomy, ("STUCK", "STUCK_IDLE")),
    (autonomy_child, ("READY_TIME", "ANSWER_TIME")),
)  # fmt: skip


@pytest.fixture
def patient_adapters(monkeypatch):
    """A robot or a mind that says nothing for a second is given up. Here that second may be the machine's, which has others to serve."""
    for module, names in SECONDS:
        for name in names:
            monkeypatch.setattr(module, name, patient(getattr(module, name)))
