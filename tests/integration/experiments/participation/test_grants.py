"""Assignment to conditions, on what terms, and who may not have a robot of a study."""

import datetime
from collections import Counter

import msgspec
import pytest
from django.urls import reverse
from django.utils import timezone

from experiments.definition.course import CourseTrack
from experiments.definition.schema import digest, from_stored
from experiments.models import Draw, Drive, Participant, ParticipantKind, Study, StudyMember
from experiments.participation import advance, grants
from experiments.participation.grants import StudyTerms
from experiments.tasks.finalization import settle_place
from experiments.tasks.stored_records import track_of
from robots.access import may_drive, may_observe
from robots.models import Robot, RobotPermit, RobotPresence
from sessions.consumers import queries
from sessions.leases import store, terms
from sessions.models import Session
from tests.support.people import person
from tests.support.studies import participants as p
from tests.support.studies.studies import PRACTICE, STUDY, cabin, small_study
from tests.support.studies.study_site import cabin_with_giraff, robot_at
from tests.support.studies.task_drives import track

pytestmark = pytest.mark.django_db
SURE = {"best_probability": 1.0}  # always the cell with the fewest


def keep_online() -> None:
    """Mark the robots as online for longer than any test takes."""
    RobotPresence.objects.update(
        connection="ONLINE", last_seen_at=timezone.now() + datetime.timedelta(hours=1)
    )


@pytest.fixture
def robot():
    cabin_with_giraff()
    keep_online()
    return Robot.objects.get(name="giraff")


@pytest.fixture
def study(robot):
    return p.published(small_study(allocation=SURE))


def take(robot: Robot, user, **more) -> store.Taken:
    robot.refresh_from_db()
    return queries.take(
        robot,
        user,
        f"peer-{user}",
        session=None,
        old_peer=None,
        takeover=False,
        device={},
        now=timezone.now(),
        **more,
    )


def leave(session: str) -> None:
    """End a session, and make the robot ready for the next one."""
    store.end(session, "cancelled", "left", timezone.now())
    RobotPresence.objects.update(turnaround="ready")


def drives(robot: Robot, participant: Participant) -> Drive:
    """The participant gets the robot, and leaves it."""
    RobotPresence.objects.update(turnaround="ready")
    granted = take(robot, participant.user)
    assert isinstance(granted, store.TakeGranted), granted
    leave(granted.session)
    return Drive.objects.get(session=granted.session)


@pytest.fixture
def ada(study) -> Participant:
    return p.comer(study, person("ada"))


def comers(study: Study, count: int, **more) -> list[Participant]:
    return [
        p.comer(study, person(f"visitor-{study.slug}-{n}-{more.get('kind', '')}"), **more)
        for n in range(count)
    ]


def test_first_grant_assigns_a_condition_and_fixes_its_terms(robot, ada):
    granted = take(robot, ada.user)
    ada.refresh_from_db()
    drive = Drive.objects.get(session=granted.session)
    assert (ada.stage, ada.cell) == ("under_way", drive.condition)
    assert ada.conditions == [drive.condition]
    draw = ada.draws.get()
    assert set(draw.best) == {"all_open", "shut"}
    assert (draw.cell, draw.reason) == (ada.cell, "first")
    assert draw.counts == {"all_open": 0, "shut": 0}
    assert (drive.step, drive.visit, drive.round, drive.number) == ("task", 1, 0, 1)
    assert (drive.exposed_at, drive.moved, drive.settled_at) == (None, False, None)
    fixed = granted.terms
    assert fixed == terms.of(Session.objects.get())
    assert fixed == msgspec.convert(drive.assigned["terms"], terms.Terms)
    assert (fixed.assist, fixed.controllers, fixed.grace_seconds) == ("off", ("keyboard",), 120.0)
    assert fixed.turn_seconds > 5 * 60.0
    assert fixed.doors == {"door": "closed" if drive.condition == "shut" else "open"}
    assert {"photo", "stop", "cancel"} <= set(fixed.actions)
    assert not {"goto", "dock"} & set(fixed.actions)
    assert fixed.leaving_completes is False
    course = msgspec.to_builtins(track(drive.condition))
    assert track_of(drive) == msgspec.convert(course, CourseTrack)


def test_presence_is_asked_only_in_conditions_that_require_it(robot, ada):
    pending = grants.pending_drive(ada.user, robot)
    condition = pending.definition.conditions[0]
    asked = msgspec.structs.replace(condition, idle_seconds=45.0)
    both = [grants.terms_of(pending, one, robot, 1).idle_seconds for one in (condition, asked)]
    assert both == [0.0, 45.0]


def test_a_reload_changes_nothing(robot, ada):
    first = take(robot, ada.user)
    ada.refresh_from_db()
    again = store.take(robot, ada.user, "peer-2", takeover=True, now=timezone.now())
    assert (again.session, again.terms) == (first.session, first.terms)
    assert StudyTerms().granted(Session.objects.get(), timezone.now()) == first.terms
    assert Drive.objects.count() == 1
    seen = Participant.objects.get()
    assert (seen.cell, seen.draws_applied) == (ada.cell, 1)
    assert Draw.objects.count() == 1


def test_cells_fill_evenly_and_every_draw_can_be_repeated(robot, study):
    for participant in comers(study, 9):
        drives(robot, participant)
    counts = Counter(Participant.objects.values_list("cell", flat=True))
    assert sorted(counts.values()) == [4, 5]
    assert all(draw.cell in draw.best for draw in Draw.objects.all())
    assert list(Draw.objects.values_list("number", flat=True)) == list(range(1, 10))


def test_pilots_and_bots_are_assigned_among_themselves(robot, study):
    for kind in (ParticipantKind.BOT, ParticipantKind.PILOT, ParticipantKind.PARTICIPANT):
        for participant in comers(study, 2, kind=kind):
            drives(robot, participant)
    for kind in ParticipantKind:
        cells = Participant.objects.filter(kind=kind).values_list("cell", flat=True)
        assert sorted(cells) == ["all_open", "shut"]


def test_a_participant_on_a_second_visit_keeps_the_cell(robot, ada):
    first = drives(robot, ada)
    Participant.objects.update(stage="filled", status="finished")
    ada.refresh_from_db()
    assert advance.begin_next_visit(ada, timezone.now())
    Participant.objects.update(step="task")
    second = drives(robot, ada)
    assert (second.condition, second.number, second.visit) == (first.condition, 2, 2)
    assert Participant.objects.get().stage == "filled"


def test_a_participant_whose_place_was_freed_is_drawn_again(robot, study):
    ada, ben = comers(study, 2)
    drives(robot, ada)
    Participant.objects.filter(pk=ada.pk).update(stage="freed")
    drives(robot, ben)
    Participant.objects.filter(pk=ben.pk).update(stage="filled")
    drives(robot, ada)
    ada.refresh_from_db()
    ben.refresh_from_db()
    assert (ada.stage, ada.cell) == ("under_way", "shut" if ben.cell == "all_open" else "all_open")


def test_within_participants_each_round_has_the_next_condition(robot):
    repeated = [{**STUDY["steps"][0], "repeat": True}, {**STUDY["steps"][1], "repeat": True}]
    study = p.published(
        small_study(slug="within", allocation={"design": "within", "order": "all"}, steps=repeated)
    )
    participant = p.comer(study, person("ada"))
    first = drives(robot, participant)
    Participant.objects.update(round=1, step="task")
    second = drives(robot, participant)
    participant.refresh_from_db()
    assert [first.condition, second.condition] == participant.conditions
    assert (first.round, second.round, participant.cell) == (0, 1, "-".join(participant.conditions))


def test_a_practice_drive_has_no_course_and_is_completed_by_leaving(robot):
    steps = [PRACTICE, *STUDY["steps"]]
    participant = p.comer(p.published(small_study(steps=steps)), person("ada"))
    granted = take(robot, participant.user)
    drive = Drive.objects.get()
    assert (drive.step, track_of(drive), granted.terms.leaving_completes) == ("try", None, True)


def two_robots(**changes) -> tuple[Study, dict[str, Robot]]:
    """The paper's study, whose conditions with open doors are open to all; one is on each robot."""
    robots = {series: p.site(series=series) for series in ("giraff", "rhodon")}
    conditions = [
        {**msgspec.to_builtins(one), "access": "open"}
        for one in p.of("exploration").conditions
        if not one.doors_closed
    ]
    more = {"conditions": conditions, "analyses": [], "plan": None, **changes}
    return p.published(p.of("exploration", **more)), robots


def shown_step(client, one: Participant):
    """The page of a participant's task, whom it may have assigned."""
    Participant.objects.filter(pk=one.pk).update(step="task")
    client.force_login(one.user)
    page = client.get(reverse("study_step", args=[one.study.slug]))
    one.refresh_from_db()
    return page


def test_participants_cannot_choose_a_condition_by_choosing_the_robot(client):
    study, robots = two_robots(allocation={"design": "between", **SURE})
    for one in comers(study, 4):
        Participant.objects.filter(pk=one.pk).update(step="task")
        assert grants.claimed(one.user, list(robots.values())) == [], "before the draw"
        given = shown_step(client, one).context["robot"]
        assert shown_step(client, one).context["robot"] == given
        assert one.cell == f"{given.presence.factsheet['series']}_open"
        assert grants.claimed(one.user, list(robots.values())) == [given]
        for robot in robots.values():
            leave(take(robot, one.user).session)
        assert [drive.session.robot for drive in one.drives.all()] == [given]
    draws = Draw.objects.all()
    assert Counter(draw.cell for draw in draws) == {"giraff_open": 2, "rhodon_open": 2}
    assert all(set(draw.counts) == {"giraff_open", "rhodon_open"} for draw in draws)


def test_a_participant_who_learned_of_their_robot_is_not_drawn_again(client):
    study, _robots = two_robots()
    one = p.comer(study, person("ada"))
    given = shown_step(client, one).context["robot"]
    settle_place(p.drive_of(given, one, outcome="connection_refused"))
    one.refresh_from_db()
    assert (one.stage, one.draws_applied) == ("under_way", 1)
    assert shown_step(client, one).context["robot"] == given


def test_nobody_is_assigned_to_a_robot_while_the_study_is_closed(client):
    study, _robots = two_robots()
    one = p.comer(study, person("ada"))
    Study.objects.update(status="closed")
    assert "This study is over" in shown_step(client, one).content.decode()
    assert not Draw.objects.exists()


# --- who may not ----------------------------------------------------------------------------------


def test_full_study_refuses_new_participants_also_in_a_race(robot, monkeypatch):
    study = p.published(small_study(allocation={"quota": 1}))
    ada, ben, cem = comers(study, 3)
    drives(robot, ada)
    drives(robot, ben)
    assert take(robot, cem.user) == store.Refused(reason="full")
    assert not Session.objects.filter(visitor=cem.user).exists()
    # the last place was taken while this participant asked
    monkeypatch.setattr(grants.PendingDrive, "why_not", lambda *_: "")
    refused = take(robot, cem.user)
    assert refused.reason == "full"
    assert Session.objects.get(pk=refused.session).outcome == "cancelled"
    assert not Drive.objects.filter(participant=cem).exists()


@pytest.mark.parametrize("closed", [{"opening_hours": p.in_two_days()}, {"status": "closed"}])
def test_no_drive_begins_in_a_closed_study(robot, ada, closed):
    Study.objects.update(**closed)
    assert take(robot, ada.user) == store.Refused(reason="closed")


def test_an_exclusive_study_reserves_its_robot(robot):
    study = p.published(small_study(), exclusive=True)
    participant, stranger, operator = p.comer(study, person("ada")), person("ben"), person("olga")
    RobotPermit.objects.create(robot=robot, user=operator, kind="operator")
    assert take(robot, stranger) == store.Refused(reason="reserved")
    assert isinstance(take(robot, operator), store.TakeGranted)
    leave(str(Session.objects.get().pk))
    assert isinstance(take(robot, participant.user), store.TakeGranted)


def test_study_drives_are_private_unless_the_study_allows_observers(robot):
    participant = p.comer(p.published(small_study()), person("ada"))
    granted = take(robot, participant.user)
    assert (granted.terms.private, granted.lease.private) == (True, True)
    staff = {role: person(role) for role in ("owner", "researcher", "viewer", "coder", "wizard")}
    for role, user in staff.items():
        StudyMember.objects.create(slug=participant.study.slug, user=user, role=role)
    stranger = person("ben")
    StudyMember.objects.create(slug="another", user=stranger, role="owner")
    asked = {**staff, "participant": participant.user, "stranger": stranger}
    may = {name for name, user in asked.items() if queries.may_watch_private(user, granted.session)}
    assert may == {"owner", "researcher", "participant"}
    private = queries.private_drive(stranger, robot)
    assert private == queries.PrivateDrive(granted.session, may_watch=False)


def test_studies_can_allow_observers_and_older_studies_keep_their_digest(robot):
    was_frozen_as = digest(from_stored(small_study()))
    assert digest(from_stored(small_study(observers_allowed=False))) == was_frozen_as
    participant = p.comer(p.published(small_study(observers_allowed=True)), person("ada"))
    granted = take(robot, participant.user)
    assert (granted.terms.private, granted.lease.private) == (False, False)
    assert queries.private_drive(person("ben"), robot) is None


BY_INVITATION = [{**one, "access": "invitation"} for one in STUDY["conditions"]]


def test_invited_participants_drive_a_robot_by_invitation_only_at_their_task(robot):
    Robot.objects.update(access="invitation")
    robot.refresh_from_db()
    study = p.published(small_study(conditions=BY_INVITATION))
    invited, stranger = p.comer(study, person("ada"), access="invitation"), person("ben")
    assert may_drive(invited.user, robot)
    assert not may_observe(invited.user, robot)
    assert may_drive(stranger, robot).reason == "not_invited"
    drives(robot, invited)
    Participant.objects.update(step="experience")
    assert may_drive(invited.user, robot).reason == "not_invited"


def test_a_visitor_without_an_invitation_costs_one_query(robot, django_assert_num_queries):
    invited, comer = person("ada"), person("ben")
    for slug in ("first", "second", "third"):
        study = p.published(small_study(slug=slug, conditions=BY_INVITATION))
        p.comer(study, invited, access="invitation")
        p.comer(study, comer)
    Participant.objects.filter(user=invited).exclude(study__slug="first").update(step="experience")
    assert robot.floor_plan is not None, "it is read with the robot, wherever robots are shown"
    with django_assert_num_queries(1):
        assert not grants.invited_to(comer, [robot])
    with django_assert_num_queries(2):
        assert grants.invited_to(invited, [robot]) == [robot]


def test_other_visitors_drive_freely_if_the_study_is_not_exclusive(robot, study):
    granted = take(robot, person("ben"))
    assert granted.terms == terms.FREE
    assert not Drive.objects.exists()


def test_a_participant_whose_step_is_no_drive_gets_no_terms(robot, ada):
    Participant.objects.update(step="experience")
    assert take(robot, ada.user).terms == terms.FREE


def test_a_drive_that_was_driven_is_not_driven_again(robot, ada):
    drives(robot, ada)
    Drive.objects.update(moved=True)
    assert take(robot, ada.user) == store.Refused(reason="not_allowed")


def test_a_draft_is_for_pilots_and_bots(robot, study, ada):
    Study.objects.update(status="draft")
    pilot = p.comer(study, person("ben"), kind=ParticipantKind.PILOT)
    assert take(robot, ada.user).terms == terms.FREE
    leave(str(Session.objects.get().pk))
    assert take(robot, pilot.user).terms.study["slug"] == "cabin-study"


def test_robots_of_another_series_are_not_in_the_study(robot, ada):
    rhodon = robot_at(robot.floor_plan, "rhodon", "rhodon")
    keep_online()
    assert take(rhodon, ada.user).terms == terms.FREE


def remove_dock(robot: Robot) -> None:
    robot.floor_plan.plan = {**robot.floor_plan.plan, "docks": []}
    robot.floor_plan.save()


def test_a_floor_plan_that_no_longer_fits_the_study_ends_the_session(robot, ada):
    remove_dock(robot)
    assert take(robot, ada.user).reason == "not_allowed"
    assert Session.objects.get().state == "ended"


def test_the_course_of_a_drive_stays_when_the_floor_plan_changes(robot, ada):
    before = track_of(drives(robot, ada))
    remove_dock(robot)
    assert track_of(Drive.objects.get()) == before
    assert before.dock.x == cabin().docks[0].x


def test_a_visitor_who_then_takes_part_begins_again_from_the_station(robot, study):
    user = person("ada")
    free = take(robot, user).session
    Session.objects.filter(pk=free).update(state="driving", first_motion_at=timezone.now())
    p.comer(study, user)
    queued = take(robot, user)
    assert isinstance(queued, store.Queued)
    assert queued.reason.startswith("returning")
    before = Session.objects.get(pk=free)
    assert (before.state, before.outcome) == ("ended", "completed")
    assert (before.outcome_reason, before.terms) == ("begins_anew", {})
    RobotPresence.objects.update(turnaround="ready")
    granted = take(robot, user)
    assert granted.session == queued.session
    assert Drive.objects.get().session_id == Session.objects.get(pk=granted.session).pk


def test_a_visit_that_has_not_moved_yet_becomes_the_studys(robot, study):
    user = person("ada")
    free = take(robot, user).session
    p.comer(study, user)
    granted = store.take(robot, user, "peer-2", takeover=True, now=timezone.now())
    assert (granted.session, granted.terms.study["slug"]) == (free, "cabin-study")
