"""A driver asks where a goto would lead, through the whole control loop."""

import asyncio

import pytest

from robots.agent.ramp import ZERO
from robots.agent.robot_interface import AdapterError
from robots.api import messages as m
from tests.support.agents.scripted_robot import ScriptedRobot


class PlanningRobot(ScriptedRobot):
    """Knows one route; `slow` makes it plan until it is released."""

    slow = fails = False

    async def preview(self, x, y):
        while self.slow:
            await asyncio.sleep(0.01)
        if self.fails:
            raise AdapterError("no_laser")
        return ((1.0, 2.0), (x, y)), "goal_taken"


ROBOT = PlanningRobot


def ask(rig, number=1, *, peer="p1", role="driver", way="datachannel", **fields):
    fields = {"session": "s1", "epoch": 1, "x": 3.0, "y": 4.0} | fields
    request = m.RouteRequest(request_id=f"r{number}", stamp=1.0, **fields)
    if way == "mqtt":
        rig.link.say("command/route", request)
    else:
        rig.frame("command/route", request, peer=peer, role=role)


def answers(rig):
    return [(route.request_id, len(route.points), route.reason) for route in rig.link.all("route")]


@pytest.mark.parametrize("way", ["datachannel", "mqtt"])
def test_driver_is_answered_on_every_transport_and_nothing_moves(rig, way):
    ask(rig, way=way)
    rig.wait(lambda: answers(rig) == [("r1", 2, "goal_taken")])
    assert "route" in {suffix for suffix, _ in rig.media.told}
    assert all(velocity == ZERO for _, velocity in rig.robot.velocities())
    assert not rig.robot.started


def test_others_and_outdated_drivers_are_not_answered(rig):
    ask(rig, 1, peer="somebody", role="observer")
    ask(rig, 2, epoch=7)
    ask(rig, 3, session=None)
    ask(rig, 4)
    rig.wait(lambda: answers(rig))
    assert answers(rig) == [("r4", 2, "goal_taken")]


def test_of_several_requests_that_wait_the_newest_is_answered(rig):
    rig.robot.slow = True
    for number in range(1, 5):
        ask(rig, number)
        rig.sleep(0.05)
    rig.robot.slow = False
    rig.wait(lambda: [name for name, *_ in answers(rig)] == ["r1", "r4"])


def test_failure_is_answered_with_its_reason_and_the_next_request_is_planned(rig):
    rig.robot.fails = True
    ask(rig, 1)
    rig.wait(lambda: answers(rig) == [("r1", 0, "no_laser")])
    rig.robot.fails = False
    ask(rig, 2)
    rig.wait(lambda: answers(rig)[-1] == ("r2", 2, "goal_taken"))


def test_flood_of_requests_costs_the_robot_few_searches(rig):
    for number in range(60):
        ask(rig, number)
        rig.sleep(0.01)
    rig.wait(lambda: answers(rig))
    assert len(answers(rig)) <= 10
