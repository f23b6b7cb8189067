import pytest

from experiments.bots.endings import Ending
from experiments.builder.pages import BuilderPlace
from experiments.definition.shipped import shipped
from experiments.rehearsal import plan
from experiments.rehearsal.report import NOTES, PROBLEMS, Issue
from experiments.study_admin.rehearsal_report import place_of
from tests.support.studies.studies import small_study

STUDY = small_study()


def test_two_bots_go_through_every_condition_and_four_others_do_not():
    endings = plan.endings(STUDY)
    assert endings.count(Ending.COMPLETES) == 2 * len(STUDY.conditions)
    assert len(endings) == 2 * len(STUDY.conditions) + 4


def test_a_faster_computer_and_a_shorter_limit_make_a_rehearsal_shorter():
    paper = shipped()["exploration"]
    slow, fast = (plan.expected_minutes(paper, cores) for cores in (1, 4))
    assert fast < slow
    assert plan.expected_minutes(STUDY, 2) < plan.expected_minutes(paper, 2)
    assert plan.expected_minutes(paper, 1000) >= plan.START_MINUTES


@pytest.mark.parametrize(
    ("issue", "place"),
    [
        (Issue("missed", {"number": 1}, "shut"), BuilderPlace("courses", 0)),
        (Issue("not_applied", {"what": "assist"}, "shut"), BuilderPlace("conditions", 1)),
        (Issue("too_short", {}, "shut"), BuilderPlace("steps", 0)),
        (Issue("stuck", {}, place="Experience"), BuilderPlace("steps", 1)),
        (Issue("empty", {"column": "experience.a"}), BuilderPlace("steps", 1)),
        (Issue("empty", {"column": "states.charge"}), None),
        (Issue("stuck", {}, place="A page that is gone"), None),
        (Issue("missed", {"number": 1}, "a condition that is gone"), None),
        (Issue("no_code", {"bot": 1}), BuilderPlace("steps")),
    ],
)
def test_an_issue_leads_to_the_page_on_which_it_is_corrected(issue, place):
    assert place_of(issue, STUDY) == place


def test_no_kind_of_issue_is_both_a_problem_and_a_note():
    assert not PROBLEMS.keys() & NOTES.keys()
