"""Which response of a participant counts, by the rule of the study, printed under the table."""

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
    """Return the finished responses that count to a questionnaire, in the order of their sessions.
    With a condition, those about its sessions: a participant has one that counts in each condition.
    """
    order = {
        one.id: index
        for index, one in enumerate(dataset.sessions)
        if condition is None or one.condition == condition
    }
    finished = [
        one
        for one in dataset.responses
        if one.questionnaire == questionnaire
        and one.finished
        and (condition is None or one.session in order)
    ]
    finished.sort(key=lambda one: order.get(one.session, -1))
    rule = dataset.study.analysis.counts
    if rule == "all":
        return finished
    in_order = finished if rule == "last" else reversed(finished)
    counting = {one.participant: one.id for one in in_order}
    return [one for one in finished if counting[one.participant] == one.id]


def note(dataset: Dataset, responses: Sequence[ResponseRecord]) -> str:
    """Return the rule, and the numbers of participants and sessions that it leaves."""
    people = len({one.participant for one in responses})
    sessions = len({one.session for one in responses if one.session})
    return (
        f"{RULES[dataset.study.analysis.counts]} {amount(people, 'participant')},"
        f" {amount(sessions, 'session')}, {amount(len(responses), 'response')}."
    )
