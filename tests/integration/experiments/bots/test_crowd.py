"""The bots whose round trips show how late the computer is: those that drive and are connected."""

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
    """The part of a participant that a group reads."""

    def __init__(self, cockpit: Cockpit) -> None:
        self.drive = SimpleNamespace(cockpit=cockpit, view=cockpit.view)


async def test_bots_without_a_connection_do_not_slow_the_others_down():
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
        # a robot whose heartbeat is long overdue at a connected bot
        assert crowd._round_trips()[0] > 0.9 * LATER
        await cockpit.lose_network()
        assert crowd._round_trips() == []
        await cockpit.come_back()
        assert await cockpit.until(lambda: cockpit.view.granted, patient(5.0))
        assert len(crowd._round_trips()) == 1
        await cockpit.close()
        assert crowd._round_trips() == []
