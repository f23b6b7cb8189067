import datetime

import pytest
from django.utils import timezone

from experiments.definition.recruitment.recruiting import ENDINGS
from experiments.models import Participant, ParticipantKind, StepVisit, Study, StudyMember
from experiments.participation import advance, completion, landing, progress
from experiments.participation.drive_status import DriveStatus
from experiments.participation.journey import JourneyPlace
from experiments.participation.questions import ask, context_key
from tests.support.people import person
from tests.support.studies import participants as p

pytestmark = pytest.mark.django_db


@pytest.fixture
def study():
    return p.published(p.of("exploration"))


@pytest.fixture
def twice():
    return p.published(p.of("assistance"))


def answer(participant: Participant) -> None:
    """Answer the questions of the step of a participant."""
    step = progress.step_of(participant)
    about = {"drive": DriveStatus(), "now": timezone.now()}
    given = ask(participant, progress.place(participant), step, **about)
    type(given).objects.filter(pk=given.pk).update(finished_at=timezone.now())


def test_coming_in_twice_makes_one_row_at_the_first_step(study):
    user = person()
    first = p.comer(study, user, recruitment={"PROLIFIC_PID": "abc"}, language="es-mx")
    second = p.comer(study, user, recruitment={"PROLIFIC_PID": "other"}, language="en")
    assert first.pk == second.pk
    assert progress.place(second) == JourneyPlace(1, 0, "consent")
    assert second.recruitment == {"PROLIFIC_PID": "abc"}
    assert (second.language, second.kind) == ("es", "participant")
    assert list(StepVisit.objects.values_list("step", "finished_at")) == [("consent", None)]


def test_a_later_invitation_widens_the_access_only_before_the_assignment(study):
    user = person()
    p.comer(study, user)
    assert p.comer(study, user, access="invitation").access == "invitation"
    other = p.assign(p.comer(study, person("bob")), "giraff_open")
    assert p.comer(study, other.user, access="invitation").access == "open"


def test_going_on_happens_once_however_often_it_is_asked(study):
    participant = p.comer(study, person())
    here = progress.place(participant)
    stale = Participant.objects.get(pk=participant.pk)
    assert advance.go_on(participant, here, timezone.now())
    assert not advance.go_on(stale, here, timezone.now())
    assert progress.place(stale) == JourneyPlace(1, 0, "about_you")
    assert {row.step: row.finished_at is None for row in StepVisit.objects.all()} == {
        "consent": False,
        "about_you": True,
    }


def test_a_place_of_another_visit_or_study_is_refused(study):
    participant = p.comer(study, person())
    for there in (
        JourneyPlace(2, 0, "consent"),
        JourneyPlace(1, 1, "consent"),
        JourneyPlace(1, 0, "nothing"),
        JourneyPlace(1, 0, "task"),
    ):
        assert not advance.go_on(participant, there, timezone.now())
    assert progress.place(participant) == JourneyPlace(1, 0, "consent")


def walk(participant: Participant) -> list[str]:
    passed = []
    while participant.status == "active":
        passed.append(progress.place(participant).word)
        assert advance.go_on(participant, progress.place(participant), timezone.now())
    return passed


def test_the_way_through_the_papers_study_ends_at_the_thanks_with_a_code(study):
    participant = p.comer(study, person())
    steps = ("consent", "about_you", "instructions", "task", "experience")
    assert walk(participant) == [f"1.0.{step}" for step in steps]
    # without a drive
    assert (participant.step, participant.completion) == ("thanks", "technical_failure")
    assert participant.completion_code == completion.code(study, "technical_failure")


def test_within_participants_the_repeated_steps_are_gone_through_for_each_condition(twice):
    participant = p.comer(twice, person())
    assert [word for word in walk(participant) if "task" in word] == ["1.0.task", "1.1.task"]
    p.assign(participant, "assisted", "alone")
    participant.round = 0
    assert progress.wanted_condition(participant, twice.as_definition()).key == "assisted"
    participant.round = 1
    assert progress.wanted_condition(participant, twice.as_definition()).key == "alone"
    participant.round = 2
    assert progress.wanted_condition(participant, twice.as_definition()) is None


def test_on_the_next_visit_consent_and_form_are_skipped_and_the_cell_stays(study):
    from experiments.participation.consent import agree

    participant = p.comer(study, person())
    agree(participant, progress.step_of(participant), language="en", age=30, now=timezone.now())
    advance.go_on(participant, progress.place(participant), timezone.now())
    answer(participant)
    walk(participant)
    p.assign(participant, "giraff_open")
    assert advance.begin_next_visit(participant, timezone.now())
    assert progress.place(participant) == JourneyPlace(2, 0, "instructions")
    assert (participant.status, participant.cell) == ("active", "giraff_open")
    assert not advance.begin_next_visit(participant, timezone.now())
    assert walk(participant) == ["2.0.instructions", "2.0.task", "2.0.experience"]
    steps = {step.key: step for step in study.as_definition().steps}

    def contexts(step: str) -> set[str]:
        places = [JourneyPlace(visit, 0, step) for visit in (1, 2)]
        return {context_key(participant, place, steps[step]) for place in places}

    assert len(contexts("experience")) == 2
    assert len(contexts("about_you")) == 1


def test_ending_is_technical_until_a_drive_with_motion_succeeds(study):
    robot = p.site("office")
    participant = p.assign(p.comer(study, person()), "giraff_open")
    Participant.objects.filter(pk=participant.pk).update(step="task")
    for outcome, moved, ending in (
        ("robot_fault", True, "technical_failure"),
        ("cancelled", False, "technical_failure"),
        ("timed_out", True, "timed_out"),
        ("completed", True, "done"),
    ):
        p.drive_of(robot, participant, outcome=outcome, moved=moved)
        assert completion.ending_of(participant) == ending
    completion.conclude(participant, timezone.now())
    p.drive_of(robot, participant, outcome="connection_lost", moved=True)
    completion.conclude(participant, timezone.now())
    assert participant.completion == "done"


def test_codes_depend_on_ending_and_study_alone(study, twice):
    codes = {completion.code(one, ending) for one in (study, twice) for ending in ENDINGS}
    assert len(codes) == 8  # without a recruitment site, those who drove share a code
    assert completion.code(study, "done") == completion.code(Study.objects.get(pk=study.pk), "done")


def test_each_user_sees_their_version(study):
    researcher, visitor = person("rita"), person("vic")
    StudyMember.objects.create(slug="exploration", user=researcher, role="viewer")
    draft = p.publishing.store(p.of("exploration", version=2), timezone.now())
    assert progress.study_for(researcher, "exploration") == draft
    assert progress.study_for(person("root", is_superuser=True), "exploration") == draft
    assert progress.study_for(visitor, "exploration") == study
    assert progress.kind_of(researcher, study) == ParticipantKind.PILOT
    began = p.comer(study, visitor)
    Study.objects.filter(pk=draft.pk).update(status="published")
    Study.objects.filter(pk=study.pk).update(status="closed")
    assert progress.study_for(visitor, "exploration") == study, "which they have begun"
    Participant.objects.filter(pk=began.pk).update(status="finished")
    assert progress.study_for(visitor, "exploration") == draft
    assert progress.study_for(visitor, "nothing") is None


def test_home_page_lists_open_studies_and_when_closed_studies_open(study, twice):
    now = datetime.datetime(2026, 3, 7, 12, 0, tzinfo=datetime.UTC)  # a Saturday
    assert {one.slug for one in progress.visible_studies(now)} == {"exploration", "assistance"}
    Study.objects.filter(pk=study.pk).update(
        opening_hours=[{"days": [0], "start": "09:00", "end": "10:00"}]
    )
    assert [one.slug for one in progress.visible_studies(now)] == ["assistance", "exploration"]
    opens = {one["slug"]: one["opens_at"] for one in landing.invitations("en", now)}
    assert opens == {
        "assistance": None,
        "exploration": datetime.datetime(2026, 3, 9, 9, 0),  # noqa: DTZ001 -- local time of a form
    }
    Study.objects.filter(pk=twice.pk).update(entry="personal")
    assert [one.slug for one in progress.visible_studies(now)] == ["exploration"]


def test_a_study_is_full_when_every_cell_has_its_quota():
    study = p.published(p.of("exploration"))
    assert not progress.is_full(study, "open", p.later(0))
    p.fill(study)
    study.refresh_from_db()
    assert progress.is_full(study, "open", p.later(0))
    assert not progress.is_full(study, "invitation", p.later(0))
    assert not progress.is_full(study, "open", p.later(0), ParticipantKind.PILOT)


def test_all_conditions_open_to_a_participant_are_possible_before_assignment(study):
    for name, access, series in (("ada", "open", "giraff"), ("eva", "invitation", "rhodon")):
        participant = p.comer(study, person(name), access=access)
        assert {one.robot for one in progress.open_conditions(participant)} == {series}
    assigned = p.assign(p.comer(study, person("ann")), "giraff_lab_closed")
    assert [one.key for one in progress.open_conditions(assigned)] == ["giraff_lab_closed"]
