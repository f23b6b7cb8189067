"""Whose robots a study may use."""

import pytest
from django.urls import reverse
from django.utils import timezone

from experiments import publishing
from experiments.models import Study, StudyMember
from experiments.participation.drive_status import robot_for
from experiments.participation.robot_eligibility import may_see, may_use
from robots.access import may_drive
from robots.models import Robot, RobotPermit
from tests.support.people import person
from tests.support.sessions import replays
from tests.support.studies import participants as p
from tests.support.studies.studies import STUDY, small_study
from tests.support.studies.study_site import cabin_with_giraff

pytestmark = pytest.mark.django_db


@pytest.fixture
def robot():
    """A robot with an owner, without operators."""
    cabin_with_giraff()
    Robot.objects.update(access="invitation", owner=person("owner", is_staff=True))
    return Robot.objects.get()


@pytest.fixture
def mallory():
    """A researcher with a study of their own, and no robot."""
    user = person("mallory", is_staff=True)
    StudyMember.objects.create(slug="cabin-study", user=user, role="owner")
    return user


def by(user, **more) -> Study:
    study = p.published(
        small_study(conditions=[{**one, "access": "invitation"} for one in STUDY["conditions"]]),
        **more,
    )
    Study.objects.update(published_by=user)
    return study


def test_a_robot_without_an_owner_is_every_studys():
    assert may_use("any", replays.cabin_robot())


def test_a_study_cannot_invite_onto_a_robot_of_another_owner(robot, mallory):
    guest = p.comer(by(mallory), person("guest"), access="invitation")
    assert may_drive(guest.user, robot).reason == "not_invited"
    permit = RobotPermit.objects.create(robot=robot, user=mallory, kind="operator")
    assert may_drive(guest.user, robot)
    permit.delete()
    assert may_drive(guest.user, robot).reason == "not_invited"


def test_to_make_its_owner_a_member_of_the_study_lends_no_robot(robot, mallory):
    guest = p.comer(by(mallory), person("guest"), access="invitation")
    StudyMember.objects.create(slug="cabin-study", user=robot.owner, role="owner")
    assert may_drive(guest.user, robot).reason == "not_invited"


def test_an_exclusive_study_does_not_reserve_a_robot_of_another_owner(robot, mallory):
    from experiments.participation.grants import StudyTerms

    Robot.objects.update(access="open")
    study, stranger = by(mallory, exclusive=True), person("stranger")
    assert StudyTerms().why_not(stranger, robot, timezone.now()) == ""
    Study.objects.filter(pk=study.pk).update(published_by=robot.owner)
    assert StudyTerms().why_not(stranger, robot, timezone.now()) == "reserved"


def test_a_researcher_neither_sees_nor_holds_a_robot_of_another_owner(client, robot, mallory):
    by(mallory)
    client.force_login(mallory)
    assert client.get(reverse("study_live_data", args=["cabin-study"])).json()["robots"] == []
    hold = {"act": "hold", "robot": "giraff", "text": "mine now"}
    assert client.post(reverse("study_live_act", args=["cabin-study"]), hold).status_code == 404
    Robot.objects.update(access="open")
    assert may_see("cabin-study", Robot.objects.get())
    assert not may_see("cabin-study", Robot(owner=robot.owner, shown_to_visitors=False))
    assert client.post(reverse("study_live_act", args=["cabin-study"]), hold).status_code == 404
    Study.objects.update(published_by=robot.owner)
    assert client.post(reverse("study_live_act", args=["cabin-study"]), hold).status_code == 200


def test_a_draft_cannot_use_robots(robot, mallory):
    by(robot.owner)
    Study.objects.update(status="draft")
    assert not may_use("cabin-study", robot)


def test_a_participant_is_led_to_a_robot_that_visitors_see(robot):
    Robot.objects.update(access="open")
    shown = replays.cabin_robot("other-giraff")
    participant = p.comer(by(robot.owner), person("guest"), access="invitation")
    Robot.objects.filter(pk=robot.pk).update(shown_to_visitors=False)
    assert robot_for(participant, timezone.now())[0] == shown
    Robot.objects.filter(pk=shown.pk).update(shown_to_visitors=False)
    assert robot_for(participant, timezone.now())[0] is None


def test_the_publisher_is_stored(robot):
    row = publishing.publish(
        publishing.store(small_study(), timezone.now()),
        robot.owner,
        "because it is a test",
        timezone.now(),
    )
    assert row.published_by == robot.owner
    assert may_use("cabin-study", robot)


def test_the_check_of_a_robot_costs_the_same_for_many_publishers(
    robot, django_assert_max_num_queries
):
    study = by(person("first"))
    for number in range(2, 8):
        version = Study.objects.get(pk=study.pk)
        version.pk, version.version, version.published_by = (
            None,
            number,
            person(f"publisher-{number}"),
        )
        Study.objects.bulk_create([version])
    with django_assert_max_num_queries(2):
        assert not may_use(study.slug, robot)
