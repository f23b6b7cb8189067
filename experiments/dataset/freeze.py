"""When the definition of a study was frozen, and whether its data came later."""

import tomllib
from pathlib import Path

from django.conf import settings

from experiments.analysis.dataset.records import FreezeRecord
from experiments.models import Participant, ParticipantKind, Study


def freeze_of(study: Study) -> FreezeRecord:
    """Return what is known of a version's publication."""
    known = FreezeRecord(
        sha256=study.sha256, deviations=study.deviations, software=software_version()
    )
    at = study.published_at
    if at is None:
        return known
    people = Participant.objects.filter(study__slug=study.slug, kind=ParticipantKind.PARTICIPANT)
    return FreezeRecord(
        sha256=known.sha256,
        frozen_at=f"{at:%Y-%m-%d %H:%M} UTC",
        before_data=not people.filter(study=study, created_at__lt=at).exists(),
        earlier=people.filter(study__version__lt=study.version, created_at__lt=at).count(),
        deviations=known.deviations,
        software=known.software,
    )


def software_version() -> str:
    """Return the version of the server's software; empty where its project file is not there."""
    path = Path(settings.BASE_DIR) / "pyproject.toml"
    if not path.is_file():
        return ""
    project = tomllib.loads(path.read_text(encoding="utf-8")).get("project", {})
    return str(project.get("version", ""))
