"""The quality flags of a study's participants, from the database."""

from collections import Counter
from collections.abc import Iterable, Iterator

from experiments.analysis.quality.flags import flags_of
from experiments.definition.recruitment.quality_flags import Flag, Grade
from experiments.extraction.build import dataset_of
from experiments.extraction.sessions import drives_of
from experiments.models import Participant, ParticipantKind, Study


def flags_of_study(study: Study, participants: Iterable[str] | None = None) -> tuple[Flag, ...]:
    """Return the flags of a study's participants, or of some of them by code; every session of
    theirs is read.
    """
    codes = None if participants is None else set(participants)
    dataset = dataset_of(study, drives=list(drives_of(study)))
    same = (one for one in same_id_flags(study) if codes is None or one.participant in codes)
    return (*flags_of(dataset, codes), *same)


def by_participant(study: Study) -> dict[str, list[Flag]]:
    """Return the flags of a study by the participant's code."""
    found: dict[str, list[Flag]] = {}
    for one in flags_of_study(study):
        found.setdefault(one.participant, []).append(one)
    return found


def same_id_flags(study: Study) -> Iterator[Flag]:
    """Yield that several participants of a study, in any version, came with one id: they joined
    before ids were recognized, or with a personal link.
    """
    rows = Participant.objects.filter(
        study__slug=study.slug, kind=ParticipantKind.PARTICIPANT
    ).exclude(recruitment_id="")
    found = list(rows.values_list("recruitment_id", "code", "study_id"))
    counts = Counter(identifier for identifier, _code, _study in found)
    for identifier, code, version in found:
        if version == study.pk and counts[identifier] > 1:
            value = f"{counts[identifier]} participants with one recruitment id"
            yield Flag(code, "same_id", Grade.SERIOUS, value)


def in_one_cell(flags: Iterable[Flag]) -> str:
    """Return flags as one cell of a table: `never_moved:3|speeding:2`, each with its highest
    grade.
    """
    grades: dict[str, int] = {}
    for one in flags:
        grades[one.name] = max(one.grade, grades.get(one.name, 0))
    return "|".join(f"{name}:{grade}" for name, grade in sorted(grades.items()))
