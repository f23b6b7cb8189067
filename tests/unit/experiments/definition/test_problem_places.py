"""Each problem of a study knows the part of it that must change, and what it says is translated."""

import pytest
from django.utils.translation import override

from experiments.definition.feasibility import Known, obstacles
from experiments.definition.problems import problems
from surveys.document_forms.problem_text import sentences
from surveys.documents import NOWHERE, ProblemPlace
from tests.support.analysis.planned import PLAN, plan_with, planned_study
from tests.support.studies.studies import STUDY, small_study
from tests.support.studies.wizard_study import WIZARD, wizard_study

LEVELS = [{"key": key, "title": {"en": key}} for key in ("ajar", "closed")]
DOORS = {"key": "doors", "title": {"en": "Doors"}, "levels": LEVELS}
HELP = {"code": "help", "name": "Asks for help", "kind": "point", "key": "h"}


def changed(part: str, index: int, **fields):
    parts = [dict(one) for one in STUDY[part]]
    parts[index] |= fields
    return {part: parts}


@pytest.mark.parametrize(
    ("study", "place"),
    [
        (small_study(slug="link"), NOWHERE),
        (small_study(title={"en": ""}), ProblemPlace("about")),
        (small_study(**changed("courses", 0, checkpoints=[])), ProblemPlace("courses", 0)),
        (small_study(**changed("steps", 1, title={"en": ""})), ProblemPlace("steps", 1)),
        (small_study(**changed("steps", 0, last_minutes=9)), ProblemPlace("steps")),
        (small_study(**changed("conditions", 1, title={"en": ""})), ProblemPlace("conditions", 1)),
        (small_study(conditions=[]), ProblemPlace("conditions")),
        (small_study(factors=[{**DOORS, "levels": LEVELS[:1]}]), ProblemPlace("factors", 0)),
        (small_study(refill={"most": 1}), ProblemPlace("rules")),
        (small_study(analyses=[{"key": "a", "title": {"en": "A"}}]), ProblemPlace("analyses", 0)),
        (planned_study(plan_with(notes="\x00")), ProblemPlace("plan")),
        (wizard_study(conditions=["ajar"]), ProblemPlace("wizard")),
        (
            wizard_study(stages=[*WIZARD["stages"], {"key": "new", "title": {"en": ""}}]),
            ProblemPlace("stages", len(WIZARD["stages"])),
        ),
        (small_study(coding={"codes": []}), ProblemPlace("coding")),
        (small_study(coding={"codes": [{**HELP, "group": "x" * 99}]}), ProblemPlace("codes", 0)),
    ],
)
def test_a_problem_leads_to_the_part_where_it_is_mended(study, place):
    assert place in {one.place for one in problems(study)}


def test_obstacles_have_places_as_well():
    nothing = Known({}, {}, frozenset())
    found = [one.place for one in obstacles(small_study(), nothing)]
    conditions = [ProblemPlace("conditions", n) for n in (0, 1)]
    assert found == [ProblemPlace("steps", 1), ProblemPlace("courses", 0), *conditions]


def test_a_missing_text_is_found_by_its_path_and_language():
    (one,) = problems(
        small_study(
            **changed(
                "courses",
                0,
                zones=[{"name": "z", "title": {}, "polygon": [[0, 0], [1, 0], [1, 1]]}],
            )
        )
    )
    assert (one.place, one.path, one.language) == (
        ProblemPlace("courses", 0),
        ("zones", 0, "title"),
        "en",
    )
    assert str(one) == "study.courses[0].zones[0].title has no text in en."


def test_problems_are_in_the_language_of_their_reader():
    found = list(problems(small_study(factors=[DOORS])))
    with override("es"):
        assert "Condición shut: elige su nivel del factor doors." in sentences(found)
        assert "Condition shut: choose its level of the factor doors." in map(str, found)


def test_a_good_plan_leads_nowhere():
    assert list(problems(planned_study(PLAN))) == []
