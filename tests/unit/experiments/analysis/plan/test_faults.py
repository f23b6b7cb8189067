"""Faults of the record of a drive for which a plan excludes it."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.analysis.plan.preregistration import preregistration
from experiments.analysis.report import reports
from experiments.dataset.columns import columns_of
from experiments.dataset.counting import attempted, counting
from experiments.dataset.records import PlanExclusion
from experiments.dataset.states import NETWORK, STATES
from tests.support.analysis.every_ending import every_ending
from tests.support.analysis.planned import plan_with

FAULTY = "again-1"  # the drive with the fault; its driver came back for another
SECONDS = np.arange(0.0, 60.0, 0.25)


def states(session: str, *, faulty: dict):
    """States without a fault, and those of FAULTY with one."""
    stamps = SECONDS
    if session == FAULTY and "gap" in faulty:
        stamps = np.delete(SECONDS, slice(80, 100))
    if session == FAULTY and "rate" in faulty:
        stamps = SECONDS[::2]
    offset = np.full(len(stamps), 0.5 if session == FAULTY and "clock" in faulty else 0.0)
    return columns_of(STATES, stamp=stamps, clock_offset=offset, boot=np.zeros(len(stamps)))


def dataset(*named: str, faulty: dict, drives: str = "all"):
    """A study whose plan names some faults, and one drive with a fault."""
    data = every_ending(plan_with(hypotheses=[], faults=list(named)), analysis={"drives": drives})
    fields = {name: value for name, value in faulty.items() if name in {"mismatch", "operator"}}
    fps = np.zeros(40) if "frozen_video" in faulty else np.full(40, 20.0)
    network = columns_of(NETWORK, stamp=np.arange(40.0), fps=fps)
    still = columns_of(NETWORK, stamp=np.arange(40.0), fps=np.full(40, 20.0))
    return replace(
        data,
        sessions=tuple(replace(it, **(fields if it.id == FAULTY else {})) for it in data.sessions),
        states=lambda session: states(session, faulty=faulty),
        network=lambda session: network if session == FAULTY else still,
    )


@pytest.mark.parametrize(
    ("named", "faulty", "words"),
    [
        ("condition", {"mismatch": "network"}, "Not applied as assigned: network."),
        ("operator", {"operator": True}, "An operator intervened."),
        ("gap", {"gap": 1}, "5.2 s without a state; at most 2 s are allowed."),
        ("rate", {"rate": 1}, "2.00 states a second; at least 3.5 are asked for."),
        ("clock", {"clock": 1}, "The clocks differed by 0.50 s; at most 0.25 s are allowed."),
        ("frozen_video", {"frozen_video": 1}, "No new video frame in 100% of the seconds."),
    ],
)
def test_a_drive_with_a_fault_that_the_plan_names_does_not_count(named, faulty, words):
    kept = counting(dataset(faulty=faulty))
    assert FAULTY in {one.id for one in kept.sessions}, "no plan names the fault"
    found = counting(dataset(named, faulty=faulty))
    assert {one.id for one in kept.sessions} - {one.id for one in found.sessions} == {FAULTY}
    rule = f"fault of the record: {named}"
    assert PlanExclusion("again", FAULTY, rule, words) in found.exclusions
    assert FAULTY not in {one.id for one in attempted(found)}


def test_another_drive_counts_in_place_of_one_with_a_fault():
    found = counting(dataset("operator", faulty={"operator": True}, drives="first"))
    assert "again-2" in {one.id for one in found.sessions}
    kept = counting(dataset(faulty={"operator": True}, drives="first"))
    assert "again-2" not in {one.id for one in kept.sessions}


def test_a_report_counts_the_drives_excluded_for_each_fault():
    data = dataset("operator", "condition", faulty={"operator": True, "mismatch": "speed"})
    report, every = reports(data)
    tables = {one.name: one for one in report.tables}
    excluded = {row[2].text for row in tables["exclusions"].rows if row[0].text == "again"}
    assert excluded == {"fault of the record: operator", "fault of the record: condition"}
    sheet = {row[1].text: row[2].text for row in tables["reporting-sheet"].rows}
    assert sheet["fault of the record: operator"] == "1 drive"
    assert sheet["fault of the record: condition"] == "1 drive"
    assert FAULTY in {one.session.id for one in every.measured}


def test_a_preregistration_names_the_faults_that_exclude_drives():
    study = dataset("gap", "operator", faulty={}).study
    text = preregistration(study, None)
    assert (
        "- Drives whose record has one of these faults are excluded from every result, and reported"
        " with the fault: a longer time without a state than the study allows; an operator"
        " intervened."
    ) in text
