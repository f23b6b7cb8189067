"""All quality flags of a dataset, for researchers, exports, and the rules of a plan."""

from collections.abc import Iterable, Iterator

from experiments.analysis.quality.answers import answer_flags
from experiments.analysis.quality.driving import driving_flags
from experiments.dataset.records import Dataset
from experiments.definition.recruitment.quality_flags import Flag, Grade

CROWD = 3  # participants on one network


def flags_of(dataset: Dataset, participants: Iterable[str] | None = None) -> tuple[Flag, ...]:
    """Return the flags of a whole study's dataset (some compare participants), by participant, the
    most serious first. With `participants`, codes, only the states of their sessions are read.
    """
    wanted = None if participants is None else set(participants)
    found = [*answer_flags(dataset), *network_flags(dataset)]
    for session in dataset.sessions:
        if wanted is None or session.participant in wanted:
            found += driving_flags(dataset, session)
    kept = (one for one in found if wanted is None or one.participant in wanted)
    return tuple(sorted(kept, key=lambda one: (one.participant, -one.grade, one.name, one.value)))


def network_flags(dataset: Dataset) -> Iterator[Flag]:
    """Flag participants on one network, which people of one home or university also share."""
    people: dict[str, set[str]] = {}
    for session in dataset.sessions:
        if session.network and session.kind == "participant":
            people.setdefault(session.network, set()).add(session.participant)
    for codes in people.values():
        if len(codes) > 1:
            grade = Grade.NOTE if len(codes) < CROWD else Grade.DOUBTFUL
            value = f"{len(codes)} participants on one network"
            yield from (Flag(code, "same_network", grade, value) for code in sorted(codes))
