"""How old commands and video were, by condition."""

import msgspec

from experiments.analysis.metrics.definitions import METRICS
from experiments.analysis.tables.delays import AGES, ages
from experiments.dataset.records import Dataset, SessionRecord
from experiments.definition.schema import Impairment, Network
from experiments.definition.shipped import shipped
from tests.support.analysis.tables import cells, measured, value

SHIPPED = shipped()["assistance"]
SLOW = Network(
    control=Impairment(delay=0.15, jitter=0.03, loss=0.02), video=Impairment(bitrate=400_000.0)
)
CONDITIONS = SHIPPED.conditions[0], msgspec.structs.replace(SHIPPED.conditions[1], network=SLOW)
STUDY = msgspec.structs.replace(SHIPPED, conditions=CONDITIONS)
CLEAN, WORSE = (condition.key for condition in CONDITIONS)


def session_with(who, condition, **values):
    session = SessionRecord(f"{who}-{condition}", who, "giraff", condition=condition)
    return measured(session, **values)


def test_a_condition_has_its_networks_in_words_and_the_medians_of_its_sessions():
    one = [
        session_with(f"p{n}", CLEAN, command_age_median=0.01 * n, command_age_p95=0.1)
        for n in range(1, 4)
    ]
    other = [session_with("p1", WORSE, command_age_median=0.17, frame_age=0.3, answer_age=0.5)]
    table = ages(Dataset(STUDY), [*one, *other])
    first, second = table.rows
    assert [cell.text for cell in first[:5]] == [CLEAN, "clean", "clean", "3", "3"]
    networks = ["delay=150,jitter=30,loss=2", "rate=400"]
    assert [cell.text for cell in second[:5]] == [WORSE, *networks, "1", "1"]
    for row, head, expected in (
        *((0, "Command, median", 0.02), (0, "Command, p95", 0.1)),
        *((1, "Video on the page, median", 0.3), (1, "Video at the wheels, median", 0.5)),
    ):
        assert value(table, row, head) == expected
    assert cells(table, second)["Command, median"].sessions == ("p1-" + WORSE,)


def test_a_condition_without_sessions_has_no_ages():
    table = ages(Dataset(STUDY), [])
    assert [[cell.value for cell in row[5:]] for row in table.rows] == [[None] * 2 * len(AGES)] * 2


def test_every_age_is_a_metric():
    ages = {name for names in AGES.values() for name in names}
    assert ages <= {column.name for column in METRICS}
