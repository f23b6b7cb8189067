"""When the definition of a study was frozen, and whether its data came later."""

from experiments.dataset.records import FreezeRecord
from experiments.models import Participant, ParticipantKind, Study
from experiments.versions import software_version


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
