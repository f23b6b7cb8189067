"""Who of a crowd tells how late the computer is: those who drive, and nobody who is away."""

import time
from types import SimpleNamespace

from experiments.bots.browser import Browser
from experiments.bots.cockpit import Cockpit
from experiments.bots.crowd import BotGroup, Plan
from robots.api.messages import Heartbeat
from tests.support.patience import patient
from tests.support.sessions.robot_socket import RobotSocket

LATER = 1000.0  # seconds


class Driving:
    """What a crowd looks at of somebody."""

    def __init__(self, cockpit: Cockpit) -> None:
        self.drive = SimpleNamespace(cockpit=cockpit, view=cockpit.view)


async def test_whoever_lost_the_network_or_closed_the_page_holds_nobody_up():
    async with RobotSocket() as server:
        cockpit = Cockpit(Browser(server.url), "/ws/robots/giraff/", "keyboard")
        crowd = BotGroup(Plan("", [], [], seed=1), clock=lambda: time.time() + LATER)
        crowd._active = {Driving(cockpit)}
        await cockpit.connect()
        cockpit.take()
        await server.until(lambda: server.all("command/heartbeat"))
        assert crowd._round_trips() == []  # the robot has not answered yet
        mine = server.all("command/heartbeat")[-1]
        await server.say(
            "heartbeat",
            Heartbeat(
                n=7,
                stamp=50.0,
                echoes=({"peer": "p1", "n": mine["n"], "stamp": mine["stamp"], "received": 49.99},),
            ),
        )
        assert await cockpit.until(lambda: cockpit.view.round_trip is not None, patient(5.0))
        # a robot that has long said nothing to somebody who listens
        assert crowd._round_trips()[0] > 0.9 * LATER
        await cockpit.lose_network()
        assert crowd._round_trips() == []
        await cockpit.come_back()
        assert await cockpit.until(lambda: cockpit.view.granted, patient(5.0))
        assert len(crowd._round_trips()) == 1
        await cockpit.close()
        assert crowd._round_trips() == []
