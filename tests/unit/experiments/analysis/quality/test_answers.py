import dataclasses

import msgspec
import pytest

from experiments.analysis.quality import (
    answer_flags,
    flags_of,
    network_flags,
    speeding,
    straight_lining,
)
from experiments.dataset.records import (
    Dataset,
    PageRecord,
    ParticipantRecord,
    ResponseRecord,
    SessionRecord,
)
from experiments.definition.recruitment.quality_flags import Grade
from experiments.definition.schema import StudyDefinition
from experiments.definition.shipped import shipped
from surveys.questionnaires import shipped as questionnaires

STUDY = shipped()["exploration"]
EXPERIENCE = questionnaires()["experience"]
ITEMS = [one.key for one in EXPERIENCE.questions() if one.score_values]


@pytest.mark.parametrize(
    ("seconds", "items", "others", "expected"),
    [
        (8.0, 8, [], None),
        (7.9, 8, [], Grade.SERIOUS),
        (19.0, 8, [60.0] * 10, Grade.DOUBTFUL),
        (19.0, 8, [60.0] * 9, None),
        (21.0, 8, [60.0] * 10, None),
        (float("nan"), 8, [60.0] * 10, None),
        (1.0, 0, [], None),
    ],
)
def test_speeding_is_judged_by_items_and_by_the_median(seconds, items, others, expected):
    assert speeding(seconds, items, others) is expected


@pytest.mark.parametrize(
    ("values", "has_reversed", "expected"),
    [
        ([2] * 5, False, Grade.NOTE),
        ([2] * 5, True, Grade.DOUBTFUL),
        ([0] * 5, True, Grade.NOTE),
        ([2] * 4, True, None),
        ([2, 2, 2, 2, 1], True, None),
    ],
)
def test_equal_answers_are_graded_by_contradiction(values, has_reversed, expected):
    assert straight_lining(values, has_reversed=has_reversed, middle=0) is expected


def dataset(seconds: float = 60.0, value: int = -2, **changes) -> Dataset:
    """One participant who answered everything alike."""
    study = msgspec.convert({**msgspec.to_builtins(STUDY), **changes}, StudyDefinition)
    return Dataset(
        study=study,
        participants=(ParticipantRecord("P"),),
        pages=(PageRecord("P", "experience", "S", seconds),),
        responses=(
            ResponseRecord("R", "experience", "P", dict.fromkeys(ITEMS, value), session="S"),
        ),
        questionnaires=(EXPERIENCE,),
    )


def test_a_questionnaire_clicked_through_is_fast_and_straight():
    names = {one.name: one.grade for one in answer_flags(dataset(seconds=3.0))}
    assert names["speeding"] is Grade.SERIOUS
    assert "straight_lining" in names


def test_an_unfinished_response_is_not_judged():
    whole = dataset(seconds=3.0)
    response = dataclasses.replace(whole.responses[0], finished=False)
    page = dataclasses.replace(whole.pages[0], finished=False)
    assert not list(answer_flags(dataclasses.replace(whole, responses=(response,), pages=(page,))))


@pytest.mark.parametrize(("answer", "fails"), [("-2", False), ("1", True)])
def test_a_failed_attention_check_of_the_plan_is_serious(answer, fails):
    check = {"questionnaire": "experience", "item": ITEMS[0], "answer": answer}
    found = list(answer_flags(dataset(plan={"attention_checks": [check]})))
    assert any(one.name == "attention_check" for one in found) is fails


def on_network(code: str, network: str, **fields) -> SessionRecord:
    return SessionRecord(f"S{code}", code, "giraff", network=network, first_motion=1.0, **fields)


def test_participants_on_one_network_are_noted_and_a_crowd_is_doubtful():
    def grades(*sessions: SessionRecord) -> dict[str, Grade]:
        whole = Dataset(study=STUDY, sessions=sessions)
        return {one.participant: one.grade for one in network_flags(whole)}

    assert grades(on_network("A", "n"), on_network("B", "m"), on_network("C", "")) == {}
    assert grades(on_network("A", "n"), on_network("A", "n")) == {}
    assert grades(on_network("A", "n"), on_network("B", "n")) == dict.fromkeys("AB", Grade.NOTE)
    assert grades(*(on_network(code, "n") for code in "ABC"))["A"] is Grade.DOUBTFUL
    assert grades(on_network("A", "n"), on_network("B", "n", kind="pilot")) == {}


def test_only_the_records_of_asked_participants_are_read():
    read = []
    whole = Dataset(
        study=STUDY,
        sessions=(on_network("A", "n"), on_network("B", "n")),
        states=lambda session: read.append(session) or Dataset(study=STUDY).states(session),
    )
    found = flags_of(whole, ["B"])
    assert read == ["SB"]
    assert [one.participant for one in found] == ["B"]
