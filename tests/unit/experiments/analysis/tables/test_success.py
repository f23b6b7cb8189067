"""Success and times in a report: whom they have, whoever gave up, came back or was excluded."""

from dataclasses import replace

import pytest

from experiments.analysis.report import reports
from experiments.dataset.records import Dataset, ParticipantRecord
from tests.support.analysis.every_ending import NEVER, drive, every_ending
from tests.support.analysis.planned import plan_with

TITLE = {"en": "Success"}
CONTRAST = {"title": {"en": "open - shut"}, "first": ["all_open"], "second": ["shut"]}
SUCCESS = [
    {"key": "success", "title": TITLE, "measures": ["completed"], "test": "proportions"}
    | {"contrasts": [CONTRAST]},
    {"key": "times", "title": TITLE, "measures": ["task_time"], "test": "times"}
    | {"contrasts": [CONTRAST]},
]


def study_of(n=12, *, ends=lambda cell, k: {}, plan=None, **changes) -> Dataset:
    """Return a study of n participants in each of two conditions, with one drive each, of which
    `ends` changes fields: k numbers the participants of a condition.
    """
    people, sessions = [], []
    for cell in ("all_open", "shut"):
        for k in range(n):
            who = f"{cell}{k:02d}"
            people.append(ParticipantRecord(who, cell=cell, place="filled", finished=True))
            sessions.append(drive(who, cell, **{"ended": 300.0, **ends(cell, k)}))
    dataset = every_ending(plan_with(hypotheses=[], **(plan or {})), analyses=SUCCESS, **changes)
    return replace(
        dataset, participants=tuple(people), sessions=tuple(sessions), responses=(), pages=()
    )


def half_give_up(cell, k):
    """Every other participant sees the video of a closed door and leaves; some are too slow."""
    if cell == "shut" and k % 2 == 0:
        return {"outcome": "cancelled", "first_motion": NEVER, "ended": 20.0}
    return {"outcome": "timed_out"} if k % 6 == 0 else {}


def half_leave_midway(cell, k):
    if cell == "shut" and k % 2 == 0:
        return {"outcome": "cancelled", "ended": 20.0}
    return {"outcome": "timed_out"} if k % 6 == 0 else {}


def tables_of(report):
    return {table.name: table for table in report.tables}


def row_of(table, label):
    """The cells of the row that begins with a label, by their heads."""
    (row,) = (row for row in table.rows if row[0].text == label)
    return dict(zip(table.head, row, strict=True))


def success_in(report):
    """The number and the share of successes of both conditions."""
    row = row_of(tables_of(report)["conditions"], "completed")
    return [row[f"{key}: {what}"].text for key in ("all_open", "shut") for what in ("n", "mean")]


@pytest.mark.parametrize("rule", ["keep", "drives", "answers"])
@pytest.mark.parametrize("ends", [half_give_up, half_leave_midway])
def test_rule_on_incomplete_cases_leaves_nobody_out_of_success(rule, ends):
    found, *_ = reports(study_of(ends=ends, plan={"incomplete": rule}))
    assert success_in(found) == ["12", "0.833", "12", "0.500"]
    (row,) = tables_of(found)["analysis-success"].rows
    cells = dict(zip(tables_of(found)["analysis-success"].head, row, strict=True))
    assert (cells["first: n"].value, cells["second: n"].value) == (12, 12)


def test_participants_who_gave_up_are_incomplete_in_everything_but_success():
    found, every = reports(study_of(ends=half_leave_midway, plan={"incomplete": "answers"}))
    speed = row_of(tables_of(found)["conditions"], "speed")
    assert speed["shut: n"].value == 0
    assert len(tables_of(found)["exclusions"].rows) == 24
    assert success_in(every) == success_in(found)


def test_sensitivity_analysis_is_made_whenever_the_plan_excludes_somebody():
    found = list(reports(study_of(ends=half_give_up, plan={"incomplete": "drives"})))
    assert [one.name for one in found] == ["counting", "all"]
    assert "exclusions-effect" in tables_of(found[0])
