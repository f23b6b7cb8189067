import pytest

from experiments.definition.schema import StudyDefinition
from experiments.definition.shipped import shipped
from experiments.participation import journey
from experiments.participation.journey import JourneyPlace, NoPlaceError
from tests.support.studies.studies import small_study


def study(*steps: str, within: bool = False) -> StudyDefinition:
    """A study of steps that are written `kind:key`, with `*` where they are repeated."""
    text = {"text": {"en": "x"}}
    needs = {
        "consent": text,
        "debrief": text,
        "instructions": {"leaves": [text]},
        "task": {"minutes": 5},
        "questionnaire": {"questionnaire": "experience"},
        "form": {"questionnaire": "ict"},
    }
    written = []
    for step in steps:
        kind, key = step.removesuffix("*").split(":")
        about = {"kind": kind, "key": key, "title": {"en": key}, "repeat": step.endswith("*")}
        written.append(about | needs[kind])
    return small_study(steps=written, allocation={"design": "within" if within else "between"})


STEPS = "consent:consent form:you instructions:read* task:task* questionnaire:after* debrief:thanks"
TWICE = study(*STEPS.split(), within=True)


def words(places) -> str:
    return " ".join(place.word for place in places)


def test_repeated_steps_are_gone_through_once_for_each_condition():
    first, second = "1.0.read 1.0.task 1.0.after", "1.1.read 1.1.task 1.1.after"
    route = f"1.0.consent 1.0.you {first} {second} 1.1.thanks"
    assert words(journey.route(TWICE, 2, 1)) == route


def test_a_study_without_repeats_has_one_round_whatever_is_asked():
    once = study("consent:consent", "task:task", "questionnaire:after")
    assert words(journey.route(once, 3, 2)) == "2.0.consent 2.0.task 2.0.after"


def test_within_studies_have_a_round_for_each_available_condition():
    assert journey.rounds(TWICE, "open") == 2
    assert journey.rounds(TWICE, "invitation") == 1
    assert journey.rounds(shipped()["exploration"], "open") == 1
    assert journey.rounds(shipped()["assistance"], "open") == 2


def test_a_later_visit_begins_behind_what_was_given_and_answered_before():
    places = journey.route(TWICE, 2, 2)
    assert journey.begin(places, {"consent", "you"}) == JourneyPlace(2, 0, "read")
    assert journey.begin(places, {"consent"}) == JourneyPlace(2, 0, "you")
    assert journey.begin(places) == JourneyPlace(2, 0, "consent")


@pytest.mark.parametrize("definition", [TWICE, *shipped().values()], ids=lambda one: one.slug)
def test_going_on_from_each_place_passes_every_place_once_and_ends(definition):
    places = journey.route(definition, journey.rounds(definition, "open"), 1)
    passed, here = [], journey.begin(places)
    while here is not None:
        passed.append(here)
        here = next(iter(journey.following(places, here)), None)
    assert tuple(passed) == places
    assert len(set(places)) == len(places)


def test_a_skipped_step_is_passed_over_also_from_itself():
    places = journey.route(TWICE, 2, 1)
    for step in ("consent", "you"):
        following = journey.following(places, JourneyPlace(1, 0, step), {"you"})
        assert following[0] == JourneyPlace(1, 0, "read")
    assert journey.following(places, JourneyPlace(1, 1, "thanks")) == []


def test_a_place_that_is_not_on_the_way_leads_nowhere():
    with pytest.raises(NoPlaceError):
        journey.following(journey.route(TWICE, 2, 1), JourneyPlace(2, 0, "consent"))


def test_a_page_sends_back_the_place_that_it_was_shown_at():
    places = journey.route(TWICE, 2, 2)
    for place in (*places, *journey.route(TWICE, 2, 1)):
        assert journey.read(place.word, places) == place


@pytest.mark.parametrize(
    "word",
    [
        *("", "1", "1.0", "1.0.nothing", "3.0.consent", "0.0.consent", "1.9.task", "1.0.thanks"),
        *("1.-1.task", "١.0.task", "1.0.task\n", "1.0.task ", "x" * 9999),
    ],
)
def test_a_forged_place_is_refused(word):
    with pytest.raises(NoPlaceError):
        journey.read(word, journey.route(TWICE, 2, 2))


def test_the_step_of_a_place_is_found_and_that_of_no_place_is_not():
    assert journey.step_at(TWICE, JourneyPlace(1, 1, "task")).key == "task"
    with pytest.raises(NoPlaceError):
        journey.step_at(TWICE, JourneyPlace(1, 1, "gone"))


def test_progress_counts_from_one_to_all():
    places = journey.route(TWICE, 2, 1)
    assert journey.share_done(places, places[0]) == (1, 9)
    assert journey.share_done(places, places[-1]) == (9, 9)


def test_skipped_steps_are_not_counted_unless_they_are_current():
    places = journey.route(TWICE, 2, 2)
    first = next(one for one in places if one.step not in {"consent", "you"})
    assert journey.share_done(places, first, {"consent", "you"}) == (1, 7)
    assert journey.share_done(places, places[-1], {"consent", "you"}) == (7, 7)
    assert journey.share_done(places, places[0], {"consent", "you"}) == (1, 8)
