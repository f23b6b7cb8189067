"""The retained settings of robots: from their rows, and from the terms of their sessions."""

import contextlib
import datetime
import itertools
import uuid

import pytest
from django.db import OperationalError, connection
from django.utils import timezone

from accounts.models import User
from robots.api import codec
from robots.api.messages import NetworkLab
from robots.models import FloorPlan, Robot, RobotPresence
from sessions.leases import store, terms
from sessions.manager.desired_state import READ_ALL_SECONDS, DesiredState
from sessions.models import Session
from sessions.shards.hashing import shard_of
from sessions.shards.ownership import Ownership

pytestmark = pytest.mark.django_db
NOW = timezone.now()
LATER, LATEST = (NOW + datetime.timedelta(seconds=n * READ_ALL_SECONDS) for n in (1, 2))


@pytest.fixture
def office():
    return FloorPlan.objects.create(
        name="office",
        title="Office",
        resolution=0.05,
        origin_x=0.0,
        origin_y=0.0,
        width=1,
        height=1,
        image=b"png",
        sha256="a" * 64,
    )


@pytest.fixture
def giraff(office):
    return Robot.objects.create(
        name="giraff",
        title="Giraff",
        floor_plan=office,
        assist="slow",
        doors={"lab-door": "closed"},
    )


def published(outbound_messages):
    found = {
        outbound.topic.rpartition("/")[2]: codec.decode(
            outbound.topic.rpartition("/")[2], outbound.payload, "to_robot"
        )
        for outbound in outbound_messages
    }
    assert all(outbound.retain for outbound in outbound_messages)
    return found


def look(orders, now):
    return list(orders.tick(now))


def test_a_robot_is_told_assistance_doors_and_map_once(giraff):
    orders = DesiredState()
    first = published(look(orders, NOW))
    assert (first["config"].assist, first["config"].doors) == ("slow", {"lab-door": "closed"})
    assert first["floorplan"].map_id == "office"
    assert look(orders, NOW) == []


def test_only_changes_in_the_administration_are_published(giraff, office):
    orders = DesiredState()
    look(orders, NOW)
    Robot.objects.update(doors={"lab-door": "open"})
    assert published(look(orders, LATER))["config"].doors == {"lab-door": "open"}
    FloorPlan.objects.update(plan={"docks": []})
    assert list(published(look(orders, LATEST))) == ["floorplan"]


def test_a_robot_whose_map_has_just_been_made_is_told_it_when_maps_are_read_again(giraff, office):
    orders = DesiredState()
    Robot.objects.update(floor_plan=None)
    look(orders, NOW)
    copy = FloorPlan.objects.get(pk=office.pk)
    copy.pk, copy.name = uuid.uuid4(), "annexe"
    copy.save(force_insert=True)
    Robot.objects.update(floor_plan=copy)
    look(orders, NOW)
    assert published(look(orders, LATER))["floorplan"].map_id == "annexe"


def test_a_robot_without_a_map_is_told_the_rest(giraff):
    Robot.objects.update(floor_plan=None)
    assert list(published(look(DesiredState(), NOW))) == ["config"]


def begin_session(robot: Robot, **fixed) -> str:
    RobotPresence.objects.update(connection="ONLINE", last_seen_at=NOW)
    robot.refresh_from_db()
    session = store.take(
        robot, User.objects.create(username=f"user-{User.objects.count()}"), "p1", now=NOW
    ).session
    Session.objects.filter(pk=session).update(
        terms=terms.stored(terms.Terms(**fixed)), state="driving"
    )
    return session


def test_the_terms_of_a_visit_go_before_the_robots_own_and_are_undone_when_it_is_over(
    giraff, office
):
    FloorPlan.objects.update(
        plan={"doors": [{"name": "lounge-door"}, {"name": "store-door", "state": "closed"}]}
    )
    orders = DesiredState()
    look(orders, NOW)
    slow = NetworkLab(delay=0.2)
    session = begin_session(
        giraff,
        assist="off",
        doors={"lounge-door": "closed", "store-door": "open", "lab-door": "open"},
        control_network=slow,
    )
    during = published(look(orders, NOW))["config"]
    assert (during.assist, during.control_network, during.video_network) == ("off", slow, None)
    assert during.network_session == session, (
        "nobody else gets it, however late the next word comes"
    )
    assert during.doors == {"lounge-door": "closed", "store-door": "open", "lab-door": "open"}
    assert look(orders, NOW) == []
    store.end(session, "cancelled", "left", NOW)
    afterwards = published(look(orders, NOW))["config"]
    assert (afterwards.assist, afterwards.control_network, afterwards.network_session) == (
        "slow",
        None,
        None,
    )
    assert afterwards.doors == {"lounge-door": "open", "store-door": "closed", "lab-door": "closed"}


def test_a_session_manager_that_was_away_when_a_visit_ended_undoes_its_doors(giraff):
    session = begin_session(giraff, doors={"lounge-door": "closed"})
    store.end(session, "cancelled", "left", NOW)
    assert published(look(DesiredState(), NOW))["config"].doors == {
        "lounge-door": "open",
        "lab-door": "closed",
    }


def test_a_robot_that_is_anothers_is_told_nothing_and_everything_when_it_is_ours_again(giraff):
    ownership, shard = Ownership(), shard_of("giraff")
    ownership.become({shard: 1})
    orders = DesiredState(ownership)
    first = look(orders, NOW)
    assert set(published(first)) == {"config", "floorplan"}
    ownership.become({})
    Robot.objects.update(assist="stop")
    assert look(orders, NOW) == []
    Robot.objects.update(assist="slow")
    ownership.become({shard: 3})
    assert look(orders, NOW) == first
    assert look(orders, NOW) == []


@pytest.mark.parametrize("failing", range(1, 6))
def test_a_database_that_is_away_for_a_moment_leaves_no_robot_untold(giraff, office, failing):
    Robot.objects.create(name="another", title="Another", floor_plan=office, assist="off")
    begin_session(giraff)
    orders, asked = DesiredState(), itertools.count(1)

    def away(execute, *args):
        if next(asked) == failing:
            raise OperationalError
        return execute(*args)

    outbound = []
    with connection.execute_wrapper(away), contextlib.suppress(OperationalError):
        outbound += orders.tick(NOW)
    assert next(asked) > failing, "it took fewer questions"
    soon = NOW + datetime.timedelta(seconds=0.5)
    outbound += look(orders, soon)
    sent = sorted(message.topic.split("/")[-2:] for message in outbound)
    assert sent == [
        [name, what] for name in ("another", "giraff") for what in ("config", "floorplan")
    ]
