"""Docking and undocking, in simulation."""

import math

import pytest
from msgspec.structs import replace

from robots.agent.navigation.navigator import Navigator
from robots.agent.navigation.planning.costmap import NoWayError
from robots.agent.navigation.planning.follower import Followed, Follower
from robots.agent.ramp import ZERO
from robots.api.floorplan import Furniture
from robots.simulator.physics.drive import STILL
from robots.simulator.physics.simulation import Simulation
from robots.world.robot_models import GIRAFF, MODELS
from robots.world.sites import load_site
from tests.support.agents.navigation_rig import Rig

pytestmark = pytest.mark.long

SITE = load_site("office")
BOTH = sorted(MODELS.items())


def rig(start, model=GIRAFF, seed=1):
    return Rig(Simulation(model, SITE.plan, seed=seed, start=start), SITE.grid, seed)


def docking_beyond(x):
    """Return a robot that has approached its station up to an x in metres."""
    made = rig("1.6,6.2,3.1")
    made.navigator.dock()
    while made.sim.pose.x > x:
        assert made.step().status == "RUNNING"
    return made


@pytest.mark.parametrize(("series", "model"), BOTH)
def test_undocked_robot_has_turned_its_back_to_the_station(series, model):
    made = rig("dock", model)
    before = made.sim.pose.theta
    made.navigator.undock()
    done = made.run(30.0)
    assert (done.status, made.sim.docked, made.sim.contacts) == ("FINISHED", False, 0)
    assert made.sim.clearance() > 0.1
    assert abs(math.remainder(made.sim.pose.theta - before, math.tau)) > math.pi - 0.2


def test_undocking_finishes_without_room_to_turn(monkeypatch):
    monkeypatch.setattr(Follower, "turn", lambda *_: Followed(ZERO, "held", "thing"))
    made = rig("dock")
    made.navigator.undock()
    done = made.run(30.0)
    assert (done.status, made.sim.docked) == ("FINISHED", False)
    assert abs(math.remainder(made.sim.pose.theta - math.pi, math.tau)) < 0.1


def test_undocking_backs_out_before_it_turns():
    made = rig("dock")
    made.navigator.undock()
    seen = []
    while (step := made.step()).status == "RUNNING":
        turned = abs(math.remainder(made.sim.pose.theta - math.pi, math.tau)) > 0.1
        seen.append((round(step.progress, 6), turned))
    assert [progress for progress, _ in seen] == sorted(progress for progress, _ in seen)
    assert {turned for progress, turned in seen if progress < 0.5} == {False}
    assert {turned for progress, turned in seen if progress > 0.6} == {True}


def test_docking_a_docked_robot_and_undocking_a_free_one_finish_without_motion():
    docked = rig("dock")
    docked.navigator.dock()
    assert docked.run(3.0).status == "FINISHED"
    assert docked.sim.distance < 0.01
    free = rig("lab-centre")
    free.navigator.undock()
    assert (free.run(2.0).status, free.sim.distance) == ("FINISHED", 0.0)


def test_robot_that_slipped_out_a_little_docks_again():
    made = rig(f"0.65,6.36,{math.pi - 0.15}")
    assert not made.sim.docked
    made.navigator.dock()
    assert made.run(90.0).status == "FINISHED"
    assert made.sim.docked


@pytest.mark.nightly
def test_docking_fails_after_three_tries_without_contact(monkeypatch):
    made = rig("lab-centre")
    monkeypatch.setattr(made.sim, "_in_dock", lambda: False)
    made.navigator.dock()
    done = made.run(240.0)
    assert (done.status, made.sim.docked) == ("FAILED", False)
    assert done.reason == "dock_failed: no_contact"
    assert made.reasons.count("tries_again: no_contact") == 3
    made.settle()
    assert made.sim.motion == STILL
    assert made.sim.clearance() > 0.1


def test_robot_stuck_beside_an_open_door_backs_off():
    """An occasional turn by a degree is no progress."""
    made = rig("1.88,2.76,1.67")
    made.navigator.dock()
    done = made.run(45.0)
    assert (done.status, made.sim.docked, made.sim.contacts) == ("FINISHED", True, 0)
    assert "backs_off" in made.reasons


def test_missing_station_is_searched_and_reported(monkeypatch):
    monkeypatch.setattr("robots.agent.navigation.docking.station.find", lambda *_: None)
    made = rig("lab-centre")
    made.navigator.dock()
    done = made.run(200.0)
    assert done.status == "FAILED"
    assert done.reason == "dock_failed: not_seen"


def test_docking_without_a_station_on_the_plan_is_refused():
    nowhere = Navigator(
        SITE.grid, None, Simulation(GIRAFF, SITE.plan, seed=1).footprint, GIRAFF.limits, "giraff"
    )
    with pytest.raises(NoWayError, match="no_dock: giraff"):
        nowhere.dock()


@pytest.mark.parametrize(
    ("fault", "reason"),
    [({"laser_works": False}, "no_laser: silent"), ({"wheels_turn": False}, "wheels")],
    ids=["laser", "wheels"],
)
def test_robot_without_laser_or_wheels_in_the_last_metre_fails(fault, reason):
    made = docking_beyond(0.9)
    vars(made).update(fault)
    done = made.run(60.0)
    assert (done.status, done.reason) == ("FAILED", reason)
    assert made.sim.motion == STILL


def test_robot_that_loses_its_pose_in_the_last_metre_still_docks():
    made = docking_beyond(1.0)
    made.knows_where = False
    assert made.run(30.0).status == "FINISHED"
    assert made.sim.docked


@pytest.mark.nightly
def test_box_in_front_of_the_station_prevents_docking_and_is_not_touched():
    box = Furniture(name="parcel", kind="box", x=0.62, y=6.3, width=0.2, depth=0.2, height=0.5)
    plan = replace(SITE.plan, furniture=(*SITE.plan.furniture, box))
    made = Rig(Simulation(GIRAFF, plan, seed=1, start="1.6,6.2,3.1"), SITE.grid, 1)
    made.navigator.dock()
    done = made.run(400.0)
    assert (done.status, made.sim.contacts, made.sim.docked) == ("FAILED", 0, False)
    assert done.reason.startswith("dock_failed: ")
    made.settle()
    assert made.sim.motion == STILL
