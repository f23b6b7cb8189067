"""What the robot's safety limits made of the drivers' commands under each condition: what was
asked, allowed and applied, and whether a condition measured the limits as well as what it was made
for.
"""

import math
from collections.abc import Iterator, Sequence

from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.statistics.descriptive import spread
from experiments.analysis.tables.table import Table, TableCell, count, number, words
from experiments.dataset.records import Dataset
from experiments.definition.schema import Condition

SHARES = {"% refused": "share_refused", "% too old": "share_too_old", "% slowed": "share_slowed"}
VALUES = {
    "Asked (m/s)": "asked_speed",
    "Allowed (m/s)": "allowed_speed",
    "Applied (m/s)": "applied_speed",
    "Command age (s)": "command_age_median",
    "Command age, p95 (s)": "command_age_p95",
}
NOTABLE = 0.05  # of the commands: fewer are slowed or refused on any network now and then
BELOW = (
    "Means over sessions; too old: refused because the command, or the video frame that it "
    "answered, was too old; slowed: applied with less speed than asked for, because of such an age."
)
_PARTS = ((0.9, "nearly all"), (0.6, "most"), (0.4, "half"), (0.27, "a third"), (0.15, "a fifth"))


def safety_limits(dataset: Dataset, measured: Sequence[Measured]) -> Table:
    """Return refusals, slowing and the age of commands by condition, with what it means in words
    below.
    """
    conditions = [
        (one, [found for found in measured if found.session.condition == one.key])
        for one in dataset.study.conditions
    ]
    return Table(
        "safety-limits",
        "Commands and the robot's safety limits.",
        ("Condition", "Sessions", "Commands", *SHARES, *VALUES),
        tuple(_row(condition, own) for condition, own in conditions),
        (BELOW, *_findings(dataset, conditions)),
    )


def _row(condition: Condition, own: Sequence[Measured]) -> tuple[TableCell, ...]:
    ids = [one.session.id for one in own]
    shares = (number(_percent(_mean(own, name)), 1, ids) for name in SHARES.values())
    values = (number(_mean(own, name), 3, ids) for name in VALUES.values())
    commands = sum(int(one.values["commands"]) for one in own if one.values["commands"] > 0)
    return words(condition.key), count(len(own), ids), count(commands, ids), *shares, *values


def _findings(
    dataset: Dataset, conditions: Sequence[tuple[Condition, Sequence[Measured]]]
) -> Iterator[str]:
    """Yield the manipulation check: a sentence for each condition in which the limits had a part
    that can be seen.
    """
    for condition, own in conditions:
        acts = [
            f"{act} {_part(share)} of the commands"
            for act, name in (("slowed", "share_slowed"), ("refused", "share_too_old"))
            if (share := _mean(own, name) or 0.0) >= NOTABLE
        ]
        if acts:
            title = dataset.say(condition.title) or condition.key
            yield (
                f"With “{title}”, the robot {' and '.join(acts)}: this condition measured the"
                " safety limits as well as delay."
            )


def _part(share: float) -> str:
    words_ = next((words_ for least, words_ in _PARTS if share >= least), "some")
    return f"{words_} ({100.0 * share:.0f} %)"


def _mean(own: Sequence[Measured], name: str) -> float | None:
    return spread([one.values[name] for one in own]).mean


def _percent(share: float | None) -> float | None:
    return None if share is None or math.isnan(share) else 100.0 * share
