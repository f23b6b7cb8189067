"""Which response of a participant counts: a rule that is frozen with the study and printed under
the table.
"""

from collections.abc import Sequence

from experiments.analysis.tables.table import amount
from experiments.dataset.records import Dataset, ResponseRecord

RULES = {
    "first": "Of several responses of one participant the first counts.",
    "last": "Of several responses of one participant the last counts.",
    "all": "Every response counts, also several of one participant.",
}


def counted(
    dataset: Dataset, questionnaire: str, condition: str | None = None
) -> list[ResponseRecord]:
    """Return the finished responses to a questionnaire that count, of a dataset of what counts, in
    the order of the sessions that they were asked about.

    With a condition, those about its sessions: of a participant who had several conditions one
    response counts in each.
    """
    order = {
        one.id: index
        for index, one in enumerate(dataset.sessions)
        if condition is None or one.condition == condition
    }
    finished = [
        one for one in dataset.responses if one.questionnaire == questionnaire and one.finished
    ]
    finished = [one for one in finished if condition is None or one.session in order]
    finished.sort(key=lambda one: order.get(one.session, -1))
    rule = dataset.study.analysis.counts
    if rule == "all":
        return finished
    by_participant: dict[str, ResponseRecord] = {}
    for one in finished if rule == "last" else reversed(finished):
        by_participant[one.participant] = one
    kept = {one.id for one in by_participant.values()}
    return [one for one in finished if one.id in kept]


def note(dataset: Dataset, responses: Sequence[ResponseRecord]) -> str:
    """Return the sentence under a table: the rule, and how many participants and
    sessions it left.
    """
    people, sessions = (
        {one.participant for one in responses},
        {one.session for one in responses if one.session},
    )
    return (
        f"{RULES[dataset.study.analysis.counts]} {amount(len(people), 'participant')},"
        f" {amount(len(sessions), 'session')}, {amount(len(responses), 'response')}."
    )
