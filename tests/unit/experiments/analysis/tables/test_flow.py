"""Nobody is lost from the flow, and the funnel says where people left."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from experiments.analysis.dataset.records import (
    Dataset,
    PageRecord,
    ParticipantRecord,
    ResponseRecord,
    SessionRecord,
)
from experiments.analysis.metrics.sessions import measure_all
from experiments.analysis.report import reports
from experiments.analysis.tables.flow import FLOW, fault_sides, flow, funnel
from experiments.definition.shipped import shipped
from tests.support.analysis.study_dataset import made_up

STUDY = shipped()["exploration"]


def people():
    """One participant for each place at which one can leave."""
    return Dataset(
        STUDY,
        participants=(
            ParticipantRecord("declined", left="declined"),
            ParticipantRecord("withdrawn", cell="a", withdrawn=True),
            ParticipantRecord("refused", cell="a", left="connection refused"),
            ParticipantRecord("silent", cell="a"),
            ParticipantRecord("done", cell="b", finished=True),
        ),
        sessions=(
            SessionRecord("s1", "refused", "giraff", outcome="connection_refused"),
            SessionRecord("s2", "silent", "giraff", outcome="timed_out", first_motion=3.0),
            SessionRecord("s3", "done", "giraff", outcome="cancelled", first_motion=3.0),
            SessionRecord("s4", "done", "giraff", number=2, outcome="completed", first_motion=3.0),
        ),
        responses=(ResponseRecord("r", "experience", "done", {"q1": 1}, session="s3"),),
    )


def lines(table, cell):
    return [
        (row[1].text or row[2].text, int(row[3].value)) for row in table.rows if row[0].text == cell
    ]


def test_every_line_is_the_one_above_less_those_who_are_named_between():
    for dataset in (people(), platform_faults().chosen(), made_up(np.random.default_rng(41), 40)):
        left = None
        for label, number in lines(flow(dataset), "all"):
            if label in FLOW:
                assert left is None or number == left
                left = number
            elif label.startswith(("left: ", "excluded: ")):
                left -= number
        assert left == lines(flow(dataset), "all")[-1][1]


def platform_faults():
    """The people above, one of whom was ended by the platform in the only drive, another in one of
    two.
    """
    found = people()
    ended = {"fault_side": "platform", "outcome": "connection_lost"}
    sessions = [
        replace(one, **ended, fault_part="web_process") if one.id == "s2" else one
        for one in found.sessions
    ]
    sessions[2] = replace(sessions[2], **ended, fault_part="session_manager")
    sessions[0] = replace(sessions[0], fault_side="network")
    return replace(found, sessions=tuple(sessions))


def test_what_the_platform_ended_counts_nowhere_and_the_flow_says_how_often_and_why():
    dataset = platform_faults().chosen()
    assert [one.id for one in dataset.sessions] == ["s1", "s4"]
    assert [one.id for one in dataset.ruled_out] == ["s2", "s3"]
    assert dataset.responses == (), "an answer about a drive that does not count"
    table = flow(dataset)
    found = dict(lines(table, "all"))
    assert [found[stage] for stage in FLOW] == [5, 4, 2, 1, 0]
    assert found["excluded: platform fault: web process away"] == 1
    assert found["first task: completed"] == 1
    below = " ".join(table.notes)
    assert "1 session (platform fault: web process away)" in below
    assert "1 session (platform fault: session manager away)" in below
    row = next(row for row in table.rows if row[2].text.startswith("excluded: "))
    assert row[3].sessions == ("s2",)


def test_the_table_of_exclusions_has_them_too_and_no_number_is_made_of_them():
    (found,) = reports(platform_faults())
    quality = next(table for table in found.tables if table.name == "quality")
    excluded = {row[1].text: row[2] for row in quality.rows if row[0].text == "excluded by rule"}
    assert {reason: cell.sessions for reason, cell in excluded.items()} == {
        "platform fault: web process away": ("s2",),
        "platform fault: session manager away": ("s3",),
    }
    assert [one.session.id for one in found.measured] == ["s1", "s4"]
    sessions = next(table for table in found.tables if table.name == "sessions")
    assert [row[0].text for row in sessions.rows] == ["s1", "s4"]


def test_sessions_that_were_not_completed_stand_by_outcome_and_side():
    table = fault_sides(platform_faults().chosen())
    assert [([cell.text for cell in row], row[2].sessions) for row in table.rows] == [
        (["connection lost", "platform", "2"], ("s2", "s3")),
        (["connection refused", "network", "1"], ("s1",)),
    ]


def test_assigned_exposed_ended_and_answered_are_four_facts():
    found = dict(lines(flow(people()), "all"))
    assert [found[stage] for stage in FLOW] == [5, 4, 2, 2, 1]
    assert found["left: declined"] == 1
    assert found["left: withdrew"] == 1
    assert found["left: connection refused"] == 1
    assert found["left: not continued (yet)"] == 1


def test_outcomes_are_those_of_first_tasks():
    found = dict(lines(flow(people()), "all"))
    assert found["first task: cancelled"] == found["first task: timed out"] == 1
    assert "first task: completed" not in found


def test_every_cell_has_a_flow_of_its_own():
    assert dict(lines(flow(people()), "a"))["assigned"] == 3
    assert dict(lines(flow(people()), "b"))["answered"] == 1


def test_the_funnel_counts_who_came_who_went_on_and_how_long_it_took():
    pages = (
        PageRecord("P1", "link", seconds=2.0),
        PageRecord("P2", "link", seconds=4.0),
        PageRecord("P3", "link", finished=False),
        PageRecord("P1", "consent", seconds=30.0),
        PageRecord("P2", "consent", finished=False),
    )
    table = funnel(Dataset(STUDY, pages=pages), [])
    found = {row[0].text: [cell.value for cell in row[1:]] for row in table.rows}
    assert found["link"] == [3, 2, 1, 3.0]
    assert found["Consent"] == [2, 1, 1, 30.0]
    assert found["docked"] == [0, 0, 0, None]


@pytest.mark.slow
def test_milestones_stand_between_the_task_and_what_follows_it_and_only_fall():
    dataset = made_up(np.random.default_rng(42), 30)
    table = funnel(dataset, measure_all(dataset))
    names = [row[0].text for row in table.rows]
    assert (
        names.index("Exploration")
        < names.index("first video frame")
        < names.index("checkpoint 1")
        < names.index("docked")
        < names.index("Your experience")
    )
    milestones = table.rows[names.index("first video frame") : names.index("docked") + 1]
    assert all(
        before[2].value == after[1].value for before, after in itertools.pairwise(milestones)
    )
    assert all(row[1].value == row[2].value + row[3].value for row in milestones)
