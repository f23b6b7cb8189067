"""How old commands and video were, by condition."""

import math

import msgspec
import numpy as np

from experiments.analysis.metrics.definitions import METRICS
from experiments.analysis.metrics.milestones import Milestones
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.tables.delays import AGES, ages
from experiments.dataset.records import Dataset, SessionRecord
from experiments.definition.schema import Impairment, Network
from experiments.definition.shipped import shipped

SHIPPED = shipped()["assistance"]
SLOW = Network(
    control=Impairment(delay=0.15, jitter=0.03, loss=0.02), video=Impairment(bitrate=400_000.0)
)
CONDITIONS = SHIPPED.conditions[0], msgspec.structs.replace(SHIPPED.conditions[1], network=SLOW)
STUDY = msgspec.structs.replace(SHIPPED, conditions=CONDITIONS)
CLEAN, WORSE = (condition.key for condition in CONDITIONS)


def measured(who, condition, **values):
    nothing = {column.name: math.nan for column in METRICS}
    return Measured(
        SessionRecord(f"{who}-{condition}", who, "giraff", condition=condition),
        Milestones(),
        nothing | values,
        (),
        np.empty((0, 2)),
    )


def test_a_condition_has_its_networks_in_words_and_the_medians_of_its_sessions():
    one = [
        measured(f"p{n}", CLEAN, command_age_median=0.01 * n, command_age_p95=0.1)
        for n in range(1, 4)
    ]
    other = [measured("p1", WORSE, command_age_median=0.17, frame_age=0.3, answer_age=0.5)]
    table = ages(Dataset(STUDY), [*one, *other])
    first, second = table.rows
    assert [cell.text for cell in first[:5]] == [CLEAN, "clean", "clean", "3", "3"]
    assert [cell.text for cell in second[:5]] == [
        WORSE,
        "delay=150,jitter=30,loss=2",
        "rate=400",
        "1",
        "1",
    ]
    at = dict(zip(table.head, range(len(table.head)), strict=True))
    assert (first[at["Command, median"]].value, first[at["Command, p95"]].value) == (0.02, 0.1)
    assert (
        second[at["Video on the page, median"]].value,
        second[at["Video at the wheels, median"]].value,
    ) == (0.3, 0.5)
    assert second[at["Command, median"]].sessions == ("p1-" + WORSE,)


def test_a_condition_that_nobody_had_has_no_ages():
    table = ages(Dataset(STUDY), [])
    assert [[cell.value for cell in row[5:]] for row in table.rows] == [[None] * 2 * len(AGES)] * 2


def test_every_age_is_a_metric():
    assert {name for names in AGES.values() for name in names} <= {
        column.name for column in METRICS
    }
