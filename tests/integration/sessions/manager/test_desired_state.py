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
from tests.support.robots import floor_plan

pytestmark = pytest.mark.django_db
NOW = timezone.now()
LATER, LATEST = (NOW + datetime.timedelta(seconds=n * READ_ALL_SECONDS) for n in (1, 2))


@pytest.fixture
def office():
    return floor_plan("office", sha256="a" * 64)


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
    found = {}
    for outbound in outbound_messages:
        assert outbound.retain
        suffix = outbound.topic.rpartition("/")[2]
        found[suffix] = codec.decode(suffix, outbound.payload, "to_robot")
    return found


def tick(orders, now):
    return list(orders.tick(now))


def test_assistance_doors_and_map_of_a_robot_are_published_once(giraff):
    orders = DesiredState()
    first = published(tick(orders, NOW))
    assert (first["config"].assist, first["config"].doors) == ("slow", {"lab-door": "closed"})
    assert first["floorplan"].map_id == "office"
    assert tick(orders, NOW) == []


def test_only_changes_in_the_administration_are_published(giraff, office):
    orders = DesiredState()
    tick(orders, NOW)
    Robot.objects.update(doors={"lab-door": "open"})
    assert published(tick(orders, LATER))["config"].doors == {"lab-door": "open"}
    FloorPlan.objects.update(plan={"docks": []})
    assert list(published(tick(orders, LATEST))) == ["floorplan"]


def test_new_map_is_published_when_maps_are_read_again(giraff, office):
    orders = DesiredState()
    Robot.objects.update(floor_plan=None)
    tick(orders, NOW)
    copy = FloorPlan.objects.get(pk=office.pk)
    copy.pk, copy.name = uuid.uuid4(), "annexe"
    copy.save(force_insert=True)
    Robot.objects.update(floor_plan=copy)
    tick(orders, NOW)
    assert published(tick(orders, LATER))["floorplan"].map_id == "annexe"


def test_robot_without_a_map_gets_its_config(giraff):
    Robot.objects.update(floor_plan=None)
    assert list(published(tick(DesiredState(), NOW))) == ["config"]


def begin_session(robot: Robot, **fixed) -> str:
    RobotPresence.objects.update(connection="ONLINE", last_seen_at=NOW)
    robot.refresh_from_db()
    visitor = User.objects.create(username="visitor")
    session = store.take(robot, visitor, "p1", now=NOW).session
    Session.objects.update(terms=terms.stored(terms.Terms(**fixed)), state="driving")
    return session


def test_terms_of_a_session_override_the_robots_settings_until_it_ends(giraff, office):
    FloorPlan.objects.update(
        plan={"doors": [{"name": "lounge-door"}, {"name": "store-door", "state": "closed"}]}
    )
    orders = DesiredState()
    tick(orders, NOW)
    slow = NetworkLab(delay=0.2)
    session = begin_session(
        giraff,
        assist="off",
        doors={"lounge-door": "closed", "store-door": "open", "lab-door": "open"},
        control_network=slow,
    )
    during = published(tick(orders, NOW))["config"]
    assert (during.assist, during.control_network, during.video_network) == ("off", slow, None)
    assert during.network_session == session, "no other session may get it"
    assert during.doors == {"lounge-door": "closed", "store-door": "open", "lab-door": "open"}
    assert tick(orders, NOW) == []
    store.end(session, "cancelled", "left", NOW)
    afterwards = published(tick(orders, NOW))["config"]
    assert afterwards.assist == "slow"
    assert (afterwards.control_network, afterwards.network_session) == (None, None)
    assert afterwards.doors == {"lounge-door": "open", "store-door": "closed", "lab-door": "closed"}


def test_doors_of_a_session_that_ended_without_a_session_manager_are_reset(giraff):
    session = begin_session(giraff, doors={"lounge-door": "closed"})
    store.end(session, "cancelled", "left", NOW)
    doors = published(tick(DesiredState(), NOW))["config"].doors
    assert doors == {"lounge-door": "open", "lab-door": "closed"}


def test_settings_are_published_only_by_the_owner_of_the_robot(giraff):
    ownership, shard = Ownership(), shard_of("giraff")
    ownership.become({shard: 1})
    orders = DesiredState(ownership)
    first = tick(orders, NOW)
    assert set(published(first)) == {"config", "floorplan"}
    ownership.become({})
    Robot.objects.update(assist="stop")
    assert tick(orders, NOW) == []
    Robot.objects.update(assist="slow")
    ownership.become({shard: 3})
    assert tick(orders, NOW) == first
    assert tick(orders, NOW) == []


@pytest.mark.parametrize("failing", range(1, 6))
def test_settings_of_all_robots_are_published_although_a_query_failed(giraff, office, failing):
    Robot.objects.create(name="another", title="Another", floor_plan=office, assist="off")
    begin_session(giraff)
    orders, queries = DesiredState(), itertools.count(1)

    def away(execute, *args):
        if next(queries) == failing:
            raise OperationalError
        return execute(*args)

    outbound = []
    with connection.execute_wrapper(away), contextlib.suppress(OperationalError):
        outbound += orders.tick(NOW)
    assert next(queries) > failing, "it made fewer queries"
    soon = NOW + datetime.timedelta(seconds=0.5)
    outbound += tick(orders, soon)
    sent = sorted(message.topic.split("/")[-2:] for message in outbound)
    assert sent == [
        [name, what] for name in ("another", "giraff") for what in ("config", "floorplan")
    ]
