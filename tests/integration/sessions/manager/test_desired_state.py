"""What each robot is told to be like, retained: by its row, and by the terms of whoever has it."""

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
from robots.models import FloorPlan, Robot
from sessions.leases import store, terms
from sessions.manager.desired_state import LOOK_SECONDS, DesiredState
from sessions.models import Session
from sessions.shards.hashing import shard_of
from sessions.shards.ownership import Ownership

pytestmark = pytest.mark.django_db
NOW = timezone.now()
LATER, LATEST = (NOW + datetime.timedelta(seconds=n * LOOK_SECONDS) for n in (1, 2))


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


def said(outbound_messages):
    found = {
        outbound.topic.rpartition("/")[2]: codec.decode(
            outbound.topic.rpartition("/")[2], outbound.payload, "to_robot"
        )
        for outbound in outbound_messages
    }
    assert all(outbound.retain for outbound in outbound_messages)
    return found


def test_a_robot_is_told_assistance_doors_and_map_once(giraff):
    orders = DesiredState()
    first = said(orders.tick(NOW))
    assert (first["config"].assist, first["config"].doors) == ("slow", {"lab-door": "closed"})
    assert first["floorplan"].map_id == "office"
    assert orders.tick(NOW) == []


def test_what_is_changed_in_the_administration_is_told_and_nothing_else(giraff, office):
    orders = DesiredState()
    orders.tick(NOW)
    Robot.objects.update(doors={"lab-door": "open"})
    assert said(orders.tick(LATER))["config"].doors == {"lab-door": "open"}
    FloorPlan.objects.update(plan={"docks": []})
    assert list(said(orders.tick(LATEST))) == ["floorplan"]


def test_a_robot_whose_map_has_just_been_made_is_told_it_when_maps_are_read_again(giraff, office):
    orders = DesiredState()
    Robot.objects.update(floor_plan=None)
    orders.tick(NOW)
    copy = FloorPlan.objects.get(pk=office.pk)
    copy.pk, copy.name = uuid.uuid4(), "annexe"
    copy.save(force_insert=True)
    Robot.objects.update(floor_plan=copy)
    orders.tick(NOW)
    assert said(orders.tick(LATER))["floorplan"].map_id == "annexe"


def test_a_robot_without_a_map_is_told_the_rest(giraff):
    Robot.objects.update(floor_plan=None)
    assert list(said(DesiredState().tick(NOW))) == ["config"]


def visit(robot: Robot, **fixed) -> str:
    Robot.objects.update(connection="ONLINE", last_seen_at=NOW)
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
    orders.tick(NOW)
    slow = NetworkLab(delay=0.2)
    session = visit(
        giraff,
        assist="off",
        doors={"lounge-door": "closed", "store-door": "open", "lab-door": "open"},
        control_network=slow,
    )
    during = said(orders.tick(NOW))["config"]
    assert (during.assist, during.control_network, during.video_network) == ("off", slow, None)
    assert during.network_session == session, (
        "nobody else gets it, however late the next word comes"
    )
    assert during.doors == {"lounge-door": "closed", "store-door": "open", "lab-door": "open"}
    assert orders.tick(NOW) == []
    store.end(session, "cancelled", "left", NOW)
    afterwards = said(orders.tick(NOW))["config"]
    assert (afterwards.assist, afterwards.control_network, afterwards.network_session) == (
        "slow",
        None,
        None,
    )
    assert afterwards.doors == {"lounge-door": "open", "store-door": "closed", "lab-door": "closed"}


def test_a_session_manager_that_was_away_when_a_visit_ended_undoes_its_doors(giraff):
    session = visit(giraff, doors={"lounge-door": "closed"})
    store.end(session, "cancelled", "left", NOW)
    assert said(DesiredState().tick(NOW))["config"].doors == {
        "lounge-door": "open",
        "lab-door": "closed",
    }


def test_a_robot_that_is_anothers_is_told_nothing_and_everything_when_it_is_ours_again(giraff):
    ownership, shard = Ownership(), shard_of("giraff")
    ownership.become({shard: 1})
    orders = DesiredState(ownership)
    first = orders.tick(NOW)
    assert set(said(first)) == {"config", "floorplan"}
    ownership.become({})
    Robot.objects.update(assist="stop")
    assert orders.tick(NOW) == []
    Robot.objects.update(assist="slow")
    ownership.become({shard: 3})
    assert orders.tick(NOW) == first
    assert orders.tick(NOW) == []


@pytest.mark.parametrize("failing", range(1, 6))
def test_a_database_that_is_away_for_a_moment_leaves_no_robot_untold(giraff, office, failing):
    Robot.objects.create(name="another", title="Another", floor_plan=office, assist="off")
    visit(giraff)
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
    outbound += orders.tick(soon)
    told = sorted(message.topic.split("/")[-2:] for message in outbound)
    assert told == [
        [name, what] for name in ("another", "giraff") for what in ("config", "floorplan")
    ]


def test_what_was_left_unsaid_of_a_robot_that_is_anothers_by_now_is_not_said(giraff, office):
    ownership, asked = Ownership(), itertools.count(1)
    ownership.become({shard_of("giraff"): 1})
    orders = DesiredState(ownership)

    def away(execute, *args):
        if next(asked) == 5:
            raise OperationalError
        return execute(*args)

    with connection.execute_wrapper(away), pytest.raises(OperationalError):
        orders.tick(NOW)
    assert orders._unsaid
    ownership.become({})
    assert orders.tick(LATER) == []
