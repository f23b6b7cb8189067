"""A whole robot's autonomy, stepped in a simulated office: what it does, and how it gives up."""

import json
from dataclasses import replace

import msgspec
import pytest

from robots.agent.autonomy.area import AreaError, area_of, update_of
from robots.agent.autonomy.navigation_node import ActionError
from robots.agent.autonomy.sensor_snapshot import Body
from robots.agent.simulator.wire import Faults
from robots.api import messages as m
from robots.api.geometry import Pose2D
from robots.world.render_plan import rasterise
from robots.world.robot_models import model_of
from robots.world.sites import load_site
from tests.support.agents.headless import Headless
from tests.support.agents.headless_robot import HeadlessRobot, office


def goto(place="corridor-east", action_id="g"):
    return m.Goto(action_id=action_id, stamp=0.0, place=place)


def dock(action_id="d"):
    return m.Dock(action_id=action_id, stamp=0.0)


def changed(**fields):
    """The office with other values in its floorplan message."""
    return area_of(msgspec.structs.replace(update_of(load_site("office")), **fields))


@pytest.mark.parametrize("series", ["giraff", "rhodon"])
def test_from_its_dock_a_robot_goes_to_a_place_by_name_and_comes_home(series):
    robot = HeadlessRobot(series)
    there = robot.do(goto("Corridor, East end" if series == "giraff" else "corridor-west"))
    assert (there.status, there.reason) == ("FINISHED", "")
    assert not robot.sim.docked
    assert robot.error() < 0.15
    assert robot.do(dock()).status == "FINISHED"
    assert robot.sim.docked
    assert robot.sim.contacts == 0
    running = [n for n in robot.autonomy.news if n.action_id == "g" and n.status == "RUNNING"]
    assert len(running) > 5
    assert all(0.0 <= n.result["progress"] <= 1.0 for n in running)


def test_a_robot_in_its_only_dock_knows_where_it_is_without_being_told():
    robot = HeadlessRobot(placed=False)
    assert robot.run(5.0, lambda: robot.autonomy.pose.localized)
    assert robot.error() < 0.1


@pytest.mark.parametrize("series", ["giraff", "rhodon"])
def test_a_docked_robot_leaves_a_station_that_its_map_does_not_show(series):
    site = load_site("office")
    bare = replace(site, grid=rasterise(msgspec.structs.replace(site.plan, docks=())))
    robot = HeadlessRobot(series, area=area_of(update_of(bare)), placed=False)
    for _ in range(30):
        robot.run(0.1)
        assert robot.autonomy.pose.localized
        assert robot.error() < 0.1
    assert robot.do(goto("corridor-west")).status == "FINISHED"
    assert robot.error() < 0.15
    assert robot.sim.contacts == 0


def test_a_robot_that_was_told_where_it_stands_believes_it_though_other_places_look_alike():
    robot = HeadlessRobot(start="corridor-centre")
    robot.run(0.2)
    for _ in range(50):
        robot.run(0.1)
        assert robot.autonomy.pose.localized
        assert robot.error() < 0.1


def test_a_robot_that_nobody_told_where_it_is_refuses_to_go_and_finds_itself_when_asked():
    robot = HeadlessRobot(start="laboratory", placed=False)
    robot.autonomy.begin(m.Relocalize(action_id="r", stamp=0.0))
    assert robot.run(90.0, lambda: robot.last("r") is not None)
    found = robot.last("r")
    assert found.status in {"FINISHED", "FAILED"}
    assert (found.status == "FINISHED") == robot.autonomy.pose.localized
    assert found.reason or found.result["score"] >= 0.5


def test_it_is_told_where_it_is_with_and_without_a_heading():
    robot = HeadlessRobot(start="corridor-centre", placed=False)
    pose = robot.sim.pose
    assert (
        robot.do(
            m.Relocalize(action_id="r1", stamp=0.0, x=pose.x + 0.2, y=pose.y, theta=pose.theta),
            20.0,
        ).status
        == "FINISHED"
    )
    assert robot.error() < 0.1
    assert (
        robot.do(m.Relocalize(action_id="r2", stamp=0.0, x=pose.x, y=pose.y), 20.0).status
        == "FINISHED"
    )
    assert robot.error() < 0.1


def test_impossible_action_is_refused_with_a_reason():
    robot = HeadlessRobot()
    for action, words in (
        (goto("the moon"), "unknown_place: the moon"),
        (m.Goto(action_id="g", stamp=0.0), "no_goal"),
        (m.Goto(action_id="g", stamp=0.0, x=500.0, y=500.0), "outside"),
        (m.Follow(action_id="f", stamp=0.0, points=((0.0, 0.0),)), "no_goal"),
        (m.Tilt(action_id="t", stamp=0.0, angle=0.1), "unsupported"),
    ):
        with pytest.raises(ActionError, match=words):
            robot.autonomy.begin(action)
    assert robot.step() == m.Velocity(linear=0.0, angular=0.0)


def test_a_map_without_a_plan_is_good_for_points_and_for_nothing_with_a_name():
    robot = HeadlessRobot(area=changed(plan=None), start="corridor-centre")
    with pytest.raises(ActionError, match="no_dock"):
        robot.autonomy.begin(dock())
    with pytest.raises(ActionError, match="unknown_place"):
        robot.autonomy.begin(goto())
    pose = robot.sim.pose
    assert robot.do(m.Goto(action_id="g", stamp=0.0, x=pose.x + 1.0, y=pose.y)).status == "FINISHED"


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"image": "iVBORw0KGgo="}, "image"),
        ({"image": "no base64!"}, "."),
        ({"plan": {"version": 1}}, "plan"),
        ({"negate": True, "occupied_thresh": 0.999, "free_thresh": 0.0}, "."),
    ],
)
def test_a_map_that_is_none_is_refused_with_a_sentence(fields, words):
    model = model_of("giraff")
    with pytest.raises(AreaError, match=words):
        Headless(Body("giraff", model.footprint, model.limits), changed(**fields), None)


def test_a_newer_order_replaces_the_one_under_way_and_cancelling_stops_the_robot():
    robot = HeadlessRobot()
    robot.autonomy.begin(goto("living-room", "g1"))
    robot.run(3.0)
    robot.autonomy.begin(goto("corridor-east", "g2"))
    robot.run(6.0)
    assert (robot.last("g1").status, robot.last("g1").reason) == ("CANCELLED", "replaced")
    assert not robot.stands()
    assert len(robot.autonomy.path) > 1
    robot.autonomy.node.cancel("g1")
    robot.autonomy.node.cancel("g2")
    robot.run(2.0)
    assert robot.last("g2").status == "CANCELLED"
    assert robot.stands()
    assert robot.autonomy.path == ()


@pytest.mark.parametrize(
    ("faults", "words"),
    [
        (Faults(laser="silent"), "laser"),
        (Faults(laser="nan"), "laser"),
        (Faults(wheels_stopped=True), "wheels"),
    ],
)
def test_a_robot_that_breaks_on_its_way_stands_and_says_what_is_broken(faults, words):
    robot = HeadlessRobot()
    robot.autonomy.begin(goto("living-room"))
    robot.run(9.0)
    assert not robot.stands()
    robot.sim.faults = faults
    assert robot.run(60.0, lambda: robot.last("g") is not None), robot.last_words("g")
    assert robot.last("g").status == "FAILED"
    assert words in robot.last("g").reason
    robot.run(1.0)
    assert robot.stands()
    assert robot.sim.contacts == 0


def test_a_robot_that_is_carried_away_on_its_way_stops_and_says_that_it_is_lost_or_finds_itself():
    robot = HeadlessRobot()
    robot.autonomy.begin(goto("living-room"))
    robot.run(9.0)
    robot.sim.carry_to(
        Pose2D(
            *(
                getattr(next(p for p in robot.area.plan.places if p.name == "sofa"), name)
                for name in ("x", "y", "theta")
            )
        )
    )
    robot.run(120.0, lambda: robot.last("g") is not None)
    ended = robot.last("g")
    assert ended.status == "FINISHED" or "lost" in ended.reason, ended
    assert robot.error() < 0.3 or not robot.autonomy.pose.localized
    assert robot.sim.contacts == 0


def test_a_dock_that_cannot_be_reached_ends_with_a_reason_and_a_standing_robot():
    robot = HeadlessRobot(start="corridor-centre")
    robot.sim.set_doors({door.name: "closed" for door in robot.area.plan.doors})
    ended = robot.do(dock(), 240.0)
    assert ended.status == "FAILED"
    assert "closed" in ended.reason or "blocked" in ended.reason
    robot.run(1.0)
    assert robot.stands()
    assert robot.sim.contacts == 0


def test_help_for_a_driver_needs_neither_map_nor_pose():
    robot = HeadlessRobot(start="corridor-centre", placed=False)
    ahead = m.Velocity(linear=0.7, angular=0.0)
    begun = robot.sim.pose
    for _ in range(1500):
        told = robot.step(ahead, "slow")
        assert 0.0 <= told.linear <= ahead.linear
    assert robot.sim.contacts == 0
    assert robot.sim.pose.distance(begun) > 3.0
    assert robot.stands()
    assert robot.autonomy.monitor.why(robot.sim.time)[0] == "stop"
    assert robot.autonomy.monitor.clearance() < 0.6


def test_the_office_as_a_message_is_the_office():
    site = load_site("office")
    area = office()
    assert (area.grid.image == site.grid.image).all()
    assert area.grid.transform == site.grid.transform
    assert area.plan == site.plan
    assert json.loads(json.dumps(update_of(site).plan))["mapId"] == "office"
