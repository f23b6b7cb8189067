"""Success and times in a report: whom they have, whoever gave up, came back or was excluded."""

from dataclasses import replace

import pytest

from experiments.analysis.report import reports
from experiments.dataset.records import Dataset, EventRecord, ParticipantRecord
from tests.support.analysis.every_ending import NEVER, drive, every_ending
from tests.support.analysis.planned import plan_with

TITLE = {"en": "Success"}
WITHIN = {"design": "within", "order": "balanced"}
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


def with_returns(dataset, n, outcome="completed"):
    """Let the first participants come back for another drive in their condition."""
    again = [
        replace(one, id=f"{one.id}-again", visit=2, outcome=outcome) for one in dataset.sessions[:n]
    ]
    people = {one.participant: [one] for one in dataset.sessions}
    for one in again:
        people[one.participant].append(one)
    return replace(dataset, sessions=tuple(one for own in people.values() for one in own))


def compared_in(report):
    """The test, its n and its p value of each comparison of success and times."""
    names = ("Test", "n tested", "p")
    tables = [tables_of(report)[f"analysis-{name}"] for name in ("success", "times")]
    rows = [dict(zip(one.head, one.rows[0], strict=True)) for one in tables]
    rows += [row_of(tables_of(report)["conditions"], name) for name in ("completed", "task_time")]
    return [[row[name].text for name in names] for row in rows]


@pytest.mark.parametrize("outcome", ["completed", "timed_out"])
@pytest.mark.parametrize("rule", ["first", "all"])
def test_test_of_success_does_not_depend_on_who_comes_back(rule, outcome):
    dataset = study_of(ends=half_leave_midway, analysis={"drives": rule})
    (once,), (with_one,) = (reports(one) for one in (dataset, with_returns(dataset, 1, outcome)))
    assert [name for name, *_ in compared_in(once)] == ["N−1 χ²", "log-rank χ²"] * 2
    assert compared_in(with_one) == compared_in(once)


def test_success_within_participants_is_tested_in_pairs_whoever_comes_back():
    dataset = study_of(24, ends=half_leave_midway)
    same = {f"shut{k:02d}": f"all_open{k:02d}" for k in range(24)}
    sessions = [
        replace(one, participant=same.get(one.participant, one.participant))
        for one in with_returns(dataset, 1).sessions
    ]
    people = [replace(one, cell="all_open-shut") for one in dataset.participants[:24]]
    study = every_ending(plan_with(hypotheses=[]), analyses=SUCCESS, allocation=WITHIN).study
    dataset = replace(dataset, study=study, sessions=tuple(sessions), participants=tuple(people))
    (found,) = reports(dataset)
    assert [name for name, *_ in compared_in(found)] == ["McNemar mid-p", "score F (Cox)"] * 2


def measured_study(n, ends):
    """Return a study whose drives have times, as measured without states."""
    dataset = study_of(n, ends=ends)
    events = tuple(
        EventRecord(one.id, one.ended, "task", "docked")
        for one in dataset.sessions
        if one.outcome == "completed"
    )
    return replace(dataset, events=events)


def slow_ones_give_up(cell, k):
    """With a closed door, two of three leave after a minute, and the others succeed in time."""
    if cell == "shut" and k % 3:
        return {"outcome": "cancelled", "fault_side": "visitor", "ended": 60.0 + k}
    return {"ended": 200.0 + 5.0 * k}


def by_drives(report, measure):
    """The rows of a declared test in the sensitivity analyses of success and times."""
    table = tables_of(report)["success-sensitivity"]
    rows = [dict(zip(table.head, row, strict=True)) for row in table.rows]
    return {
        one["Drives"].text: one
        for one in rows
        if one["Measure"].text == measure and one["Analysis"].text != "conditions"
    }


def test_giving_up_is_no_uninformative_censoring_in_a_sensitivity_analysis():
    (found,) = reports(measured_study(24, slow_ones_give_up))
    planned, at_limit = by_drives(found, "task_time").values()
    assert planned["p (Holm)"].value > 0.05
    assert at_limit["p (Holm)"].value < 0.001
    assert (at_limit["Drives"].text, at_limit["Significance"].text) == (
        "giving up at the limit",
        "changes",
    )
    assert by_drives(found, "completed") == {
        "as planned": by_drives(found, "completed")["as planned"]
    }


def test_drives_that_the_robot_ended_are_left_out_in_a_sensitivity_analysis():
    def ends(cell, k):
        robot = {"outcome": "robot_fault", "fault_side": "robot", "ended": 30.0}
        return robot if cell == "shut" and k % 2 else {"ended": 200.0 + k if k else 900.0}

    (found,) = reports(measured_study(12, ends))
    planned, without = by_drives(found, "completed").values()
    assert (planned["n"].value, planned["Significance"].text) == (24, "")
    assert planned["Difference"].value == pytest.approx(0.5)
    assert (without["Drives"].text, without["n"].value) == ("without faults", 18)
    assert without["Difference"].value == 0.0


def test_study_without_faults_and_drives_given_up_has_no_sensitivity_analysis_of_success():
    (found,) = reports(study_of())
    assert tables_of(found)["success-sensitivity"].rows == ()
