"""The quality flags of a study's participants, from the database."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator

from experiments.analysis.quality import flags_of
from experiments.definition.recruitment.quality_flags import Flag, Grade
from experiments.extraction.build import dataset_of
from experiments.extraction.sessions import drives_of
from experiments.models import Participant, ParticipantKind, Study


def flags_of_study(study: Study, participants: Iterable[str] | None = None) -> tuple[Flag, ...]:
    """Return the flags of a study's participants, or of those with some codes."""
    codes = None if participants is None else set(participants)
    dataset = dataset_of(study, drives=list(drives_of(study)))
    same = (one for one in same_id_flags(study) if codes is None or one.participant in codes)
    return (*flags_of(dataset, codes), *same)


def same_id_flags(study: Study) -> Iterator[Flag]:
    """Yield a flag for each participant who shares a recruitment id with others in any version of
    the study: they joined before ids were recognized, or with a personal link.
    """
    people = Participant.objects.filter(study__slug=study.slug, kind=ParticipantKind.PARTICIPANT)
    rows = people.exclude(recruitment_id="").exclude(status=Participant.Status.WITHDRAWN)
    found = list(rows.values_list("recruitment_id", "code", "study_id"))
    counts = Counter(identifier for identifier, _code, _study in found)
    for identifier, code, version in found:
        if version == study.pk and counts[identifier] > 1:
            value = f"{counts[identifier]} participants with one recruitment id"
            yield Flag(code, "same_id", Grade.SERIOUS, value)


def flag_cells(study: Study) -> dict[str, str]:
    """Return the flags of each participant, by code, as text: `never_moved:3|speeding:2`."""
    grades: dict[str, dict[str, int]] = defaultdict(dict)
    for one in flags_of_study(study):
        own = grades[one.participant]
        own[one.name] = max(one.grade, own.get(one.name, 0))
    return {
        code: "|".join(f"{name}:{grade}" for name, grade in sorted(own.items()))
        for code, own in grades.items()
    }
