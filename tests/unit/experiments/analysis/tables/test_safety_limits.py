"""What safety limits made of commands, by condition, in numbers and in words."""

import math

import msgspec
import numpy as np
import pytest

from experiments.analysis.metrics.sessions import measure
from experiments.analysis.tables.delays import safety_limits
from experiments.dataset.columns import columns_of
from experiments.dataset.records import Dataset, SessionRecord
from experiments.dataset.states import STATES
from experiments.definition.schema import Impairment, Network
from experiments.definition.shipped import shipped
from tests.support.analysis.tables import cells

SHIPPED = shipped()["assistance"]
CLEAN = SHIPPED.conditions[0]
SLOW = {"title": {"en": "Delay 0.2 s"}, "network": Network(control=Impairment(delay=0.2))}
DELAYED = msgspec.structs.replace(SHIPPED.conditions[1], **SLOW)
STUDY = msgspec.structs.replace(SHIPPED, conditions=(CLEAN, DELAYED))


def states(*, slowed, too_old, allowed, known=True):
    """A minute of states with four commands each."""
    n = 240
    velocities = {"asked": -0.4, "allowed": -allowed, "applied": -allowed / 2.0}
    later = {"slowed": slowed} | {f"{name}_linear": one for name, one in velocities.items()}
    if not known:
        later = dict.fromkeys(later, np.nan)
    ages = {"age_sum": 0.8, "age_max": 0.21, "too_old": too_old, "refused": too_old + 0.5}
    robot = {"stamp": np.arange(n) / 4.0, "clock_offset": 0.0, "boot": 0.0, "commands": 4.0}
    return columns_of(STATES, **robot, **ages, **later)


def table(**given):
    sessions = tuple(
        SessionRecord(key, key, "giraff", condition=key, first_frame=0.0, ended=59.75)
        for key in (CLEAN.key, DELAYED.key)
    )
    clean = states(slowed=0.0, too_old=0.0, allowed=0.4)
    found = {CLEAN.key: clean, DELAYED.key: states(**given)}
    dataset = Dataset(STUDY, sessions=sessions, states=found.__getitem__)
    return safety_limits(dataset, [measure(dataset, one, ()) for one in sessions])


def numbers(table):
    return {head: cell.value for head, cell in cells(table, table.rows[1]).items()}


def test_refusals_slowing_and_the_three_series_are_shown_by_condition():
    found = numbers(table(slowed=2.0, too_old=1.5, allowed=0.12))
    assert found["Commands"] == 960
    assert found["% refused"] == pytest.approx(100.0 * 2.0 / 6.0)
    assert found["% too old"] == pytest.approx(100.0 * 1.5 / 6.0)
    assert found["% slowed"] == pytest.approx(50.0)
    assert found["Asked (m/s)"] == pytest.approx(0.4)
    assert found["Allowed (m/s)"] == pytest.approx(0.12)
    assert found["Applied (m/s)"] == pytest.approx(0.06)
    assert found["Command age (s)"] == pytest.approx(0.2)


def test_a_condition_that_measured_the_limits_is_named_in_plain_words():
    notes = table(slowed=2.0, too_old=0.0, allowed=0.12).notes
    assert notes[1:] == (
        (
            "With “Delay 0.2 s”, the robot slowed half (50 %) of the commands: this condition"
            " measured the safety limits as well as delay."
        ),
    )
    both = table(slowed=4.0, too_old=1.5, allowed=0.12).notes
    refused = "slowed nearly all (100 %) of the commands and refused a fifth (25 %) of the commands"
    assert refused in both[1]


def test_a_condition_with_young_commands_gets_no_such_sentence():
    assert len(table(slowed=0.1, too_old=0.1, allowed=0.4).notes) == 1


def test_values_that_a_robot_does_not_report_are_unknown():
    found = table(slowed=0.0, too_old=0.0, allowed=0.0, known=False)
    values = numbers(found)
    assert values["% slowed"] is None
    assert values["Asked (m/s)"] is None
    assert values["% refused"] == pytest.approx(100.0 * 0.5 / 4.5)
    assert len(found.notes) == 1


def test_a_condition_without_sessions_has_no_numbers():
    (first, _) = safety_limits(Dataset(STUDY), []).rows
    assert [cell.value for cell in first[1:3]] == [0, 0]
    assert all(cell.value is None or math.isnan(cell.value) for cell in first[3:])
