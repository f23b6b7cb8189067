"""The time at which the definition of a study was frozen, before or after its first data."""

from experiments.dataset.records import FreezeRecord
from experiments.models import Participant, ParticipantKind, Study
from experiments.versions import software_version


def freeze_of(study: Study) -> FreezeRecord:
    at, more = study.published_at, {}
    if at is not None:
        people = Participant.objects.filter(
            study__slug=study.slug, kind=ParticipantKind.PARTICIPANT, created_at__lt=at
        )
        more = {
            "frozen_at": f"{at:%Y-%m-%d %H:%M} UTC",
            "before_data": not people.filter(study=study).exists(),
            "earlier": people.filter(study__version__lt=study.version).count(),
        }
    return FreezeRecord(
        sha256=study.sha256, deviations=study.deviations, software=software_version(), **more
    )
