import pytest

from tests.support.architectures.patient_adapters import make_patient


@pytest.fixture
def patient_adapters(monkeypatch):
    """Adapters wait as long as a busy machine takes."""
    make_patient(monkeypatch)
