"""Contacts with a direction: which motion they prevent, what ends them, and their events."""

import itertools
import math

import pytest
from hypothesis import given, strategies as st

from robots.agent.ramp import ZERO
from robots.agent.safety.contacts import (
    BACKED_AWAY,
    BESIDE,
    CREEP,
    SIDES,
    Contacts,
    side_of,
    sides_of,
)
from robots.api.messages import Velocity
from tests.support.agents.kernel_bench import bench_with_driver
from tests.support.agents.scripted_robot import still

SIDE_SETS = st.sets(st.sampled_from(SIDES))
VELOCITIES = st.builds(
    lambda v, w: Velocity(linear=v, angular=w), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)
)


@pytest.mark.parametrize(
    ("bearing", "side"),
    [
        (0.0, "ahead"),
        (0.7, "ahead"),
        (-0.7, "ahead"),
        (1.5, "left"),
        (-1.5, "right"),
        (math.pi, "behind"),
        (-math.pi, "behind"),
        (2.4, "behind"),
    ],
)
def test_every_direction_is_on_one_side(bearing, side):
    assert side_of(bearing) == side
    assert sides_of([bearing, bearing]) == {side}


@given(SIDE_SETS, VELOCITIES)
def test_no_velocity_is_towards_a_contact_and_none_is_added(sides, velocity):
    contacts = Contacts()
    contacts.felt(sides)
    left = contacts.clamp(velocity)
    between = CREEP if {"ahead", "behind"} <= sides else 0.0
    assert "ahead" not in sides or left.linear <= between
    assert "behind" not in sides or left.linear >= -between
    assert not BESIDE & sides or left.angular == 0.0
    assert left.linear in {0.0, velocity.linear, math.copysign(between, velocity.linear)}
    assert left.angular in {0.0, velocity.angular}


@pytest.mark.parametrize("side", SIDES)
def test_a_contact_ends_after_the_robot_has_backed_away(side):
    contacts = Contacts()
    contacts.felt([side])
    away = 1.0 if side == "behind" else -1.0
    assert contacts.clamp(Velocity(linear=away * 0.1, angular=0.0)) != ZERO
    contacts.moved(away * 0.04)
    assert contacts.sides == (side,)
    contacts.moved(away * BACKED_AWAY)
    assert not contacts


def test_contact_beside_a_robot_at_rest_prevents_turns_until_it_has_driven_along():
    bench = bench_with_driver()
    bench.kernel.touched(["left"])
    bench.run(0.5, every=0.06, linear=0.0, angular=0.5)
    assert bench.kernel.commanded == ZERO
    assert bench.kernel.inhibited(bench.now) == "collision"
    bench.run(1.5, every=0.06, linear=0.2, angular=0.5)
    assert bench.kernel.inhibited(bench.now) is None
    assert bench.kernel.commanded.angular > 0.0


# --- through the agent ----------------------------------------------------------------------------


def test_a_contact_is_an_event_with_its_side_and_a_state_for_as_long_as_it_lasts(rig):
    rig.robot.reading = still(bumper=())
    rig.drive(0.4)
    rig.robot.reading = still(bumper=(0.1,), contacts=1)
    assert rig.event("collision").detail == "ahead"
    rig.wait(lambda: rig.robot.told == ZERO)
    state = rig.link.wait("state", lambda s: s.safety.touched == ("ahead",))
    assert (state.safety.collision, state.safety.inhibited) == (True, "collision")
    rig.drive(-0.2)
    rig.sleep(1.0)
    assert rig.state().safety.touched == ("ahead",), "the bumper is still pressed"
    rig.robot.reading = still(bumper=(), contacts=1)
    rig.drive(-0.2)
    rig.sleep(1.0)
    rig.drive(0.3)
    assert rig.state().safety.touched == ()
    assert len([e for e in rig.link.all("event") if e.type == "collision"]) == 1


def test_a_second_side_is_a_second_contact_though_the_first_one_lasts(rig):
    rig.robot.reading = still(bumper=(0.0,), contacts=1)
    assert rig.event("collision").detail == "ahead"
    rig.robot.reading = still(bumper=(0.0, math.pi), contacts=1)
    rig.link.wait("event", lambda e: e.type == "collision" and e.detail == "ahead behind")


def test_a_counted_contact_prevents_motion_in_the_direction_of_travel(rig):
    rig.drive(0.4)
    rig.robot.reading = still(contacts=1)
    assert rig.event("collision").detail == ""
    assert rig.link.wait("state", lambda s: s.safety.touched).safety.touched == ("ahead",)
    rig.push(0.5)
    rig.sleep(0.05)
    assert rig.robot.told == ZERO


@pytest.mark.parametrize(
    "sides", [some for number in range(1, 5) for some in itertools.combinations(SIDES, number)]
)
def test_a_driver_gets_free_from_any_set_of_contacts(sides):
    contacts = Contacts()
    contacts.felt(sides)
    for _ in range(200):
        if not contacts:
            return
        wanted = Velocity(linear=-0.3 if "ahead" in contacts.sides else 0.3, angular=0.0)
        contacts.moved(contacts.clamp(wanted).linear * 0.02)
    raise AssertionError(contacts.sides)
