"""Adapters that wait as long as a busy machine takes."""

import pytest

from tests.support.architectures.patient_adapters import make_patient


@pytest.fixture
def patient_adapters(monkeypatch):
    """Where something between the test and the adapter needs it."""
    make_patient(monkeypatch)
