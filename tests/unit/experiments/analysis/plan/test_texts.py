"""The preregistration and the reporting sheet say what the study says, and where it is silent."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from experiments.analysis.plan.preregistration import NO_PLAN, UNANSWERED, preregistration
from experiments.analysis.plan.reporting_sheet import (
    EVERYBODY,
    UNKNOWN,
    as_markdown,
    reporting_sheet,
)
from experiments.dataset.counting import counting
from experiments.dataset.records import FreezeRecord, RobotRecord
from experiments.definition.shipped import shipped
from tests.support.analysis.planned import ANALYSES, PLAN, hypothesis, plan_with, planned_study
from tests.support.analysis.planned_data import planned_data
from tests.support.analysis.study_dataset import made_up, questionnaires
from tests.support.studies.studies import PRACTICE, STUDY

FROZEN = FreezeRecord(sha256="ab" * 32, frozen_at="2026-05-01 09:00 UTC", before_data=True)
TIMES = {"shut": [100.0, 110.0, 130.0], "all_open": [90.0, 95.0, 99.0]}


def answers(text):
    """The answers, by question."""
    parts = text.split("\n### ")[1:]
    return {
        question: rest.split("\n## ")[0].strip()
        for question, _, rest in (part.partition("\n") for part in parts)
    }


def test_a_preregistration_asks_in_the_order_of_the_osf():
    text = preregistration(planned_study(PLAN), FROZEN)
    assert [line[3:] for line in text.splitlines() if line.startswith("## ")] == [
        "Study information",
        "Design plan",
        "Sampling plan",
        "Variables",
        "Analysis plan",
        "Other",
        "Every number and choice",
    ]


def test_declared_answers_are_given_and_the_others_marked_as_unanswered():
    plan = plan_with(
        attention_checks=[{"questionnaire": "experience", "item": "q1", "answer": "2"}],
        speeders=[{"questionnaire": "experience", "seconds": 10}],
    )
    given = answers(preregistration(planned_study(plan), FROZEN))
    assert given["Research question"] == "Does a closed door matter?"
    assert "**h1**: A closed door takes time." in given["Hypotheses"]
    assert "analysis `driving`; `task_time`" in given["Hypotheses"]
    assert given["Sample size"] == "20 complete cases."
    assert "`experience.q1` is not “2”" in given["Data exclusion"]
    assert "`experience` in less than 10 s" in given["Data exclusion"]
    assert given["Blinding"] == given["Stopping rule"] == given["Transformations"] == UNANSWERED


def text_of(asked=(), **changes):
    study = planned_study(**{"plan": PLAN, **changes})
    return preregistration(study, FROZEN, asked)


def with_condition(**changes):
    """The conditions of the study, the first with fields replaced."""
    first, *rest = msgspec.to_builtins(planned_study(PLAN).conditions)
    return [{**first, **changes}, *rest]


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"conditions": with_condition(network={"control": {"delay": 0.3, "loss": 0.02}})},
            "network to the robot, one way: delay 300 ms, loss 2 %",
        ),
        (
            {"conditions": with_condition(network={"video": {"bitrate": 400_000.0}})},
            "network back with the video, one way: rate 400 kbit/s",
        ),
        (
            {"conditions": with_condition(speed={"linear": 0.4, "angular": 0.6})},
            "at most 0.4 m/s; at most 0.6 rad/s",
        ),
        (
            {"refill": {"outcomes": ["robot_fault"], "most": 2}},
            "are replaced, at most 2 times in each cell: robot fault.",
        ),
        ({}, "Exposed participants are not replaced."),
        ({}, "A participant who was not exposed gives the place back and is drawn anew"),
        (
            {"steps": [PRACTICE, *STUDY["steps"]]},
            "saw the robot's video in practice keeps the cell.",
        ),
        ({"steps": [PRACTICE, *STUDY["steps"]]}, "not seen for 24 hours has left"),
        (
            {"conditions": [STUDY["conditions"][0], {**STUDY["conditions"][1], "robot": "rhodon"}]},
            "Before the first drive is offered, because the robot depends on it, a participant",
        ),
        ({}, "Exposed is a participant to whom the page showed a video frame of the task."),
        ({"analysis": {"counts": "last"}}, "Of several responses of one participant the last"),
        (
            {"analysis": {"drives": "first"}},
            "Of several such drives of a participant in a condition, the first counts.",
        ),
        (
            {"plan": plan_with(incomplete="drives")},
            "are excluded from all tests except those of proportions and times",
        ),
        (
            {"analyses": [{**ANALYSES[0], "measures": ["completed"], "test": "proportions"}]},
            "of one drive of a participant in a condition: the first that counts",
        ),
        ({}, "A drive that the robot, the network or an operator ended counts, and has not"),
        ({"quality": {"longest_gap": 1.5}}, "no gap above 1.5 s"),
        ({"allocation": {"left_after_hours": 36.0}}, "- allocation.left_after_hours: 36.0"),
        ({"devices": ["computer"]}, "- Only with these devices: computer."),
        (
            {"screening": [{"questionnaire": "ict", "item": "age", "at_least": 18}]},
            "- Only with this answer to `ict.age`: at least 18.",
        ),
        (
            {"answer_quotas": [{"questionnaire": "ict", "item": "s", "answers": ["a"], "most": 5}]},
            "- At most 5 who answer `ict.s` with: a.",
        ),
        ({"appointments": {"second_after_days": 7}}, "- appointments.second_after_days: 7"),
        ({"start": {"charge": 0.3}}, "its battery has at least 30 % of its charge"),
        ({}, "`task_time` (s): from the task's event task_started (the first video frame) to its"),
    ],
)
def test_a_preregistration_names_what_can_change_results(changes, sentence):
    assert sentence in text_of(**changes)


def test_a_preregistration_names_scales_with_their_ranges_and_reversed_items():
    text = text_of(questionnaires("experience", "sus"))
    assert "- `experience.q1`: mean of the answers to q1 that were given; from -2 to 2." in text
    assert "`experience`, version 1. Reverse-coded items, counted from the other end:" in text


def test_a_preregistration_has_the_task_its_course_and_its_time_limit():
    text = text_of()
    task, course = planned_study(PLAN).task, planned_study(PLAN).courses[0]
    assert f"- Task, `{task.key}`: at most {task.minutes:g} minutes" in text
    stop = course.checkpoints[1]
    assert f"{stop.number} at ({stop.x:g}, {stop.y:g}) within {stop.radius:g} m" in text


def test_the_appendix_has_every_field_also_those_at_their_defaults():
    text = text_of().partition("## Every number and choice")[2]
    study = planned_study(PLAN)
    for name in ("allocation", "refill", "start", "quality", "analysis"):
        for field in getattr(study, name).__struct_fields__:
            assert f"- {name}.{field}: " in text


def test_a_preregistration_does_not_tell_the_codes_of_completion():
    codes = {"done": "C1D2E3F4"}
    assert "C1D2E3F4" not in text_of(recruiting={"site": "prolific", "codes": codes})


def test_a_study_of_one_condition_has_no_sentence_about_several():
    study = planned_study(None)
    one = msgspec.structs.replace(study, conditions=study.conditions[:1], analyses=())
    given = answers(preregistration(one, FROZEN))
    assert given["Study type"].startswith("Observational study")
    assert given["Randomization"] == "None: there is one condition."
    assert given["Manipulated variables"] == "None: there is one condition."
    assert "assigned" not in given["Study design"]


def test_a_direction_names_the_levels_of_an_effect():
    levels = [{"key": key, "title": {"en": f"Level {key}"}} for key in ("low", "high")]
    factor = {"key": "delay", "title": {"en": "Delay"}, "design": "between", "levels": levels}
    text = text_of(
        factors=[factor],
        plan=plan_with(hypotheses=[hypothesis(effect="delay", direction="less")]),
    )
    assert "Expected: “Level low” is smaller than “Level high”; tested two-sided." in text


@pytest.mark.parametrize(
    ("freeze", "sentence"),
    [
        (FROZEN, "Before data: yes, no participant of this version had joined."),
        (
            msgspec.structs.replace(FROZEN, before_data=False),
            "Before data: no, a participant of this version had already joined.",
        ),
        (
            msgspec.structs.replace(FROZEN, earlier=3),
            "but 3 had joined earlier versions, whose data were known.",
        ),
        (FROZEN, f"\nFrozen on 2026-05-01 09:00 UTC (SHA-256 of the definition: `{'ab' * 32}`).\n"),
        (FreezeRecord(sha256="ab" * 32), "This is a draft: the definition is not frozen"),
        (FreezeRecord(sha256="ab" * 32), f"SHA-256 of the draft: `{'ab' * 32}`."),
        (None, "When the definition was frozen is unknown."),
    ],
)
def test_preregistration_states_whether_data_existed(freeze, sentence):
    assert sentence in preregistration(planned_study(PLAN), freeze)


def test_a_text_and_a_sheet_say_the_same_of_the_freeze():
    assert "draft" not in preregistration(planned_study(PLAN), FROZEN)
    frozen, _ = sheet(freeze=FROZEN)
    draft, _ = sheet(freeze=FreezeRecord(sha256="ab" * 32))
    assert frozen["Versions", "definition frozen"] == FROZEN.frozen_at
    assert draft["Versions", "definition frozen"] == "no: a draft, which may still change"
    assert draft["Deviations from the plan", "plan frozen before data"] == "no, it is a draft"


@pytest.mark.parametrize("study", shipped().values(), ids=list(shipped()))
def test_shipped_studies_have_a_text(study):
    text = preregistration(study, None)
    assert "- Participants younger than" in text
    assert (NO_PLAN in text) == (study.plan is None)
    assert "None" not in text


def sheet(plan=PLAN, **more):
    dataset, measured = planned_data(plan, TIMES, **more)
    table = reporting_sheet(dataset, measured, dataset.participants)
    topics, found = "", {}
    for topic, item, value in table.rows:
        topics = topic.text or topics
        found[topics, item.text] = value.text
    return found, table


def test_a_sheet_counts_who_took_part_and_what_failed():
    found, _ = sheet()
    assert found["Participants", "drove a robot"] == "6"
    counted = "age, of those with a drive that counts"
    assert found["Participants", counted] == "n = 6, M = 21.0, SD = 0.9, 20 to 22"
    assert found["Failures", "completed"] == "6 drives"
    assert found["Autonomy by condition", "Open"] == "none: the participant drives"
    assert found["Deviations from the plan", "planned participants"] == "20"
    assert found["Deviations from the plan", "participants with a drive that counts"] == "6"


def test_missing_facts_of_a_sheet_are_unknown():
    found, _ = sheet(robots=(RobotRecord(name="giraff", title="Giraff", series="giraff"),))
    assert found["Participants", "recruitment"] == UNKNOWN
    counted = "sex or gender, of those with a drive that counts"
    assert found["Participants", counted] == "unknown: not asked"
    assert found["Robot Giraff", "make"] == found["Robot Giraff", "footprint (m)"] == UNKNOWN
    assert found["Robot Giraff", "Age of commands at the wheels"] == "unknown: not measured"
    assert found["Deviations from the plan", "plan frozen before data"] == UNKNOWN
    assert found["Versions", "definition frozen"] == UNKNOWN


def test_age_and_sex_are_of_the_analysed_and_of_all_who_joined():
    dataset = counting(made_up(np.random.default_rng(3), 24))
    dataset = replace(dataset, sessions=dataset.sessions[:9])
    drivers = {one.participant for one in dataset.sessions}
    ages = {one.id: 20.0 if one.id in drivers else 80.0 for one in dataset.participants}
    people = tuple(replace(one, age=ages[one.id]) for one in dataset.participants)
    found = reporting_sheet(replace(dataset, participants=people), [], people).rows
    rows = {item.text.partition(", of those ")[::2]: value.text for _, item, value in found}
    counted, everybody = ("age", "with a drive that counts"), ("age", EVERYBODY)
    assert rows[counted].startswith(f"n = {len(drivers)}, M = 20.0")
    assert rows[everybody].startswith("n = 24, M = ")
    assert rows["sex or gender", EVERYBODY] == "Woman: 6, Man: 16"
    sexes = dict(one.split(": ") for one in rows["sex or gender", counted[1]].split(", "))
    assert sum(map(int, sexes.values())) == len(drivers) < 22, "all of them registered"


def test_a_sheet_tells_what_the_researchers_state_and_what_is_known_of_the_robot():
    robot = RobotRecord(
        name="giraff", title="Giraff", series="giraff", facts={"Size (m)": "0.58 × 0.52"}
    )
    freeze = msgspec.structs.replace(FROZEN, deviations="Two more\nparticipants.", software="1.2")
    found, table = sheet(robots=(robot,), freeze=freeze)
    assert found["Robot Giraff", "footprint (m)"] == "0.58 × 0.52"
    assert "- stated by the researchers: Two more participants." in as_markdown(table)
    assert found["Versions", "software of the server"] == "1.2"


def test_a_sheet_measures_latency():
    dataset, measured = planned_data(PLAN, TIMES)
    robot = RobotRecord(name="giraff", title="Giraff", series="giraff")
    aged = [
        replace(one, values={**one.values, "command_age_median": 0.05, "command_age_p95": 0.12})
        for one in measured
    ]
    table = reporting_sheet(replace(dataset, robots=(robot,)), aged, ())
    values = [row[2].text for row in table.rows]
    assert "median 50 ms, 95th percentile 120 ms (medians over 6 drives)" in values


def test_sheet_states_that_there_is_no_plan():
    found, _ = sheet(None)
    assert found["Deviations from the plan", "plan"].startswith("none was declared")
