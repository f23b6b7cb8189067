"""All quality flags of a dataset, graded: what researchers look at, what exports list, and what the
rules of a plan may exclude by.
"""

from collections.abc import Iterable, Iterator

from experiments.analysis.quality.answers import answer_flags
from experiments.analysis.quality.driving import driving_flags
from experiments.analysis.quality.flag import Flag
from experiments.dataset.records import Dataset
from experiments.definition.recruitment.quality_flags import Grade

CROWD = 3  # participants on one network


def flags_of(dataset: Dataset, participants: Iterable[str] | None = None) -> tuple[Flag, ...]:
    """Return the flags of a dataset, by participant, the most serious first; reads the states of
    every session.

    Args:
        dataset: of a whole study, because some flags compare participants.
        participants: codes; the record of only their sessions is read. None means all.
    """
    wanted = None if participants is None else set(participants)
    found = [*answer_flags(dataset), *network_flags(dataset)]
    for session in dataset.sessions:
        if wanted is None or session.participant in wanted:
            found += driving_flags(dataset, session)
    kept = (one for one in found if wanted is None or one.participant in wanted)
    return tuple(sorted(kept, key=lambda one: (one.participant, -one.grade, one.name, one.value)))


def network_flags(dataset: Dataset) -> Iterator[Flag]:
    """Yield that participants of the study shared a network, which people of one home or university
    also do.
    """
    people: dict[str, set[str]] = {}
    for session in dataset.sessions:
        if session.network and session.kind == "participant":
            people.setdefault(session.network, set()).add(session.participant)
    for codes in people.values():
        if len(codes) > 1:
            grade = Grade.NOTE if len(codes) < CROWD else Grade.DOUBTFUL
            value = f"{len(codes)} participants on one network"
            yield from (Flag(code, "same_network", grade, value) for code in sorted(codes))
