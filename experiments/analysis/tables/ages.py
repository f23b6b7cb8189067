"""How old commands and pictures were under each condition: what a network, real or made worse, has
really done to those who drove.
"""

from collections.abc import Sequence

from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.statistics.descriptive import spread
from experiments.analysis.tables.table import Table, TableCell, count, number, words
from experiments.dataset.records import Dataset
from experiments.definition.schema import Condition
from robots.api.network_words import spell

# (median, 95th percentile) of a session, and what they are called.
AGES = {
    "Command": ("command_age_median", "command_age_p95"),
    "Video on the page": ("frame_age", "frame_age_p95"),
    "Video at the wheels": ("answer_age", "answer_age_p95"),
}
BELOW = (
    "Ages in seconds: the medians over sessions of each session's median and 95th percentile.",
    (
        "Command: from the visitor's hand to the wheels. Video on the page: from the camera to"
        " the eyes; at the wheels: from the camera over both."
    ),
    (
        "Networks: what the condition puts on them; delay and jitter in ms, loss and reorder in %,"
        " rate in kbit/s."
    ),
)


def ages(dataset: Dataset, measured: Sequence[Measured]) -> Table:
    """Return the ages of commands and pictures by condition."""
    rows = tuple(
        _row(condition, [one for one in measured if one.session.condition == condition.key])
        for condition in dataset.study.conditions
    )
    head = ("Condition", "Network to the robot", "Network back", "Participants", "Sessions")
    return Table(
        "ages",
        "Ages of commands and video.",
        (*head, *(f"{name}, {what}" for name in AGES for what in ("median", "p95"))),
        rows,
        BELOW,
    )


def _row(condition: Condition, own: Sequence[Measured]) -> tuple[TableCell, ...]:
    ids = [one.session.id for one in own]
    networks = (
        words(spell(impairment) or "clean")
        for impairment in (condition.network.control, condition.network.video)
    )
    people = count(len({one.session.participant for one in own}), ids)
    found = (
        number(spread([one.values[name] for one in own]).median, 3, ids)
        for names in AGES.values()
        for name in names
    )
    return words(condition.key), *networks, people, count(len(ids), ids), *found
