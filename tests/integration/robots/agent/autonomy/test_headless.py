"""A whole robot's navigation, stepped in a simulated office: its actions and its failures."""

import json
from dataclasses import replace

import msgspec
import pytest

from robots.agent.autonomy.area import AreaError, area_of, update_of
from robots.agent.autonomy.navigation_node import ActionError
from robots.agent.autonomy.sensor_snapshot import Body
from robots.api import messages as m
from robots.api.geometry import Pose2D
from robots.simulator.wire import Faults
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
    """Return the office with other values in its floorplan message."""
    return area_of(msgspec.structs.replace(update_of(load_site("office")), **fields))


@pytest.mark.parametrize("series", ["giraff", "rhodon"])
def test_robot_goes_from_its_dock_to_a_named_place_and_docks_again(series):
    robot = HeadlessRobot(series)
    there = robot.do(goto("Corridor, East end" if series == "giraff" else "corridor-west"))
    assert (there.status, there.reason) == ("FINISHED", "")
    assert not robot.sim.docked
    assert robot.error() < 0.15
    assert robot.do(dock()).status == "FINISHED"
    assert "looks_for_dock" in {n.reason for n in robot.autonomy.news if n.action_id == "d"}
    robot.run(1.0)
    assert robot.sim.docked
    assert robot.stands()
    assert robot.sim.contacts == 0
    running = [n for n in robot.autonomy.news if n.action_id == "g" and n.status == "RUNNING"]
    assert len(running) > 5
    assert all(0.0 <= n.result["progress"] <= 1.0 for n in running)


def stays_localized(robot, seconds):
    for _ in range(round(10 * seconds)):
        robot.run(0.1)
        assert robot.autonomy.pose.localized
        assert robot.error() < 0.1


def test_robot_in_its_only_dock_is_localized():
    robot = HeadlessRobot(placed=False)
    assert robot.run(5.0, lambda: robot.autonomy.pose.localized)
    assert robot.error() < 0.1


@pytest.mark.parametrize("series", ["giraff", "rhodon"])
def test_docked_robot_leaves_a_station_that_its_map_does_not_show(series):
    site = load_site("office")
    bare = replace(site, grid=rasterise(msgspec.structs.replace(site.plan, docks=())))
    robot = HeadlessRobot(series, area=area_of(update_of(bare)), placed=False)
    stays_localized(robot, 3.0)
    assert robot.do(goto("corridor-west")).status == "FINISHED"
    assert robot.error() < 0.15
    assert robot.sim.contacts == 0


def test_given_pose_is_kept_although_other_places_look_alike():
    robot = HeadlessRobot(start="corridor-centre")
    robot.run(0.2)
    stays_localized(robot, 5.0)


def test_unlocalized_robot_searches_its_pose_on_request():
    robot = HeadlessRobot(start="laboratory", placed=False)
    robot.autonomy.begin(m.Relocalize(action_id="r", stamp=0.0))
    assert robot.run(90.0, lambda: robot.last("r") is not None)
    found = robot.last("r")
    assert found.status in {"FINISHED", "FAILED"}
    assert (found.status == "FINISHED") == robot.autonomy.pose.localized
    assert found.reason or found.result["score"] >= 0.5


def test_given_pose_is_corrected_and_may_lack_a_heading():
    robot = HeadlessRobot(start="corridor-centre", placed=False)
    x, y, theta = robot.sim.pose
    wrong = m.Relocalize(action_id="r1", stamp=0.0, x=x + 0.4, y=y - 0.3, theta=theta + 0.25)
    for action in (wrong, m.Relocalize(action_id="r2", stamp=0.0, x=x, y=y)):
        assert robot.do(action, 20.0).status == "FINISHED"
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


def test_map_without_a_plan_allows_points_but_no_named_places():
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
def test_invalid_map_is_refused_with_a_sentence(fields, words):
    model = model_of("giraff")
    with pytest.raises(AreaError, match=words):
        Headless(Body("giraff", model.footprint, model.limits), changed(**fields), None)


def test_newer_action_replaces_the_running_one_and_cancel_stops_the_robot():
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
    ("faults", "reason"),
    [
        (Faults(laser="silent"), "no_laser: silent"),
        (Faults(laser="nan"), "no_laser: blind"),
        (Faults(wheels_stopped=True), "wheels"),
    ],
)
def test_robot_with_a_fault_stops_and_reports_it(faults, reason):
    robot = HeadlessRobot()
    robot.autonomy.begin(goto("living-room"))
    robot.run(9.0)
    assert not robot.stands()
    robot.sim.faults = faults
    assert robot.run(60.0, lambda: robot.last("g") is not None), robot.last_words("g")
    assert (robot.last("g").status, robot.last("g").reason) == ("FAILED", reason)
    robot.run(1.0)
    assert robot.stands()
    assert robot.sim.contacts == 0


def test_robot_that_is_carried_away_is_lost_or_localizes_itself():
    robot = HeadlessRobot()
    robot.autonomy.begin(goto("living-room"))
    robot.run(9.0)
    sofa = next(place for place in robot.area.plan.places if place.name == "sofa")
    robot.sim.carry_to(Pose2D(sofa.x, sofa.y, sofa.theta))
    robot.run(120.0, lambda: robot.last("g") is not None)
    ended = robot.last("g")
    assert ended.status == "FINISHED" or "lost" in ended.reason, ended
    assert robot.error() < 0.3 or not robot.autonomy.pose.localized
    assert robot.sim.contacts == 0


def test_unreachable_dock_is_reported_and_the_robot_stops():
    robot = HeadlessRobot(start="corridor-centre")
    robot.sim.set_doors({door.name: "closed" for door in robot.area.plan.doors})
    ended = robot.do(dock(), 240.0)
    assert ended.status == "FAILED"
    assert "door_closed: Laboratory door" in ended.reason
    robot.run(1.0)
    assert robot.stands()
    assert robot.sim.contacts == 0


def test_office_survives_its_floorplan_message():
    site = load_site("office")
    area = office()
    assert (area.grid.image == site.grid.image).all()
    assert area.grid.transform == site.grid.transform
    assert area.plan == site.plan
    assert json.loads(json.dumps(update_of(site).plan))["mapId"] == "office"
