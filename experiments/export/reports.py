"""Where reports on studies lie, and how they are taken away."""

import shutil
from pathlib import Path

from django.conf import settings

from experiments.models import Study


def home(study: Study) -> Path:
    """Return where the reports on a study are."""
    return Path(settings.VAR_DIR) / "analysis" / str(study.pk)


def forget(study: Study) -> None:
    """Take all reports on a study away: they show what somebody has taken back."""
    shutil.rmtree(home(study), ignore_errors=True)
