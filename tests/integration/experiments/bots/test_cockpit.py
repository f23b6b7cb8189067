import asyncio

import pytest

from experiments.bots.browser import Browser
from experiments.bots.cockpit import BEAT, Cockpit
from experiments.bots.drive import BotDrive
from experiments.bots.driver import STAND, Driver, Guide, SpeedSetting
from experiments.bots.endings import Ending
from experiments.bots.persona import Persona
from experiments.bots.view import AT_CENTRE
from robots.api.messages import Heartbeat
from robots.world.sites import load_site
from sessions import protocol
from tests.support.patience import patient
from tests.support.sessions.robot_socket import RobotSocket


async def at_the_wheel(server):
    cockpit = Cockpit(Browser(server.url), "/ws/robots/giraff/", "keyboard")
    await cockpit.connect()
    cockpit.take()
    assert await cockpit.until(lambda: cockpit.view.granted and cockpit.view.frames, patient(5.0))
    return cockpit


async def test_driving_bot_sends_heartbeats_image_requests_and_the_first_frame_event():
    async with RobotSocket() as server:
        cockpit = await at_the_wheel(server)
        await server.until(
            lambda: (
                len(server.all("command/heartbeat")) >= 3
                and len(server.all("command/picture")) >= 3
            )
        )
        assert all(beat["n"] % 2 == 1 for beat in server.all("command/heartbeat"))
        assert server.all("command/picture")[-1]["seen"] > 1000.0
        layout, first_frame = server.all("page/event")
        assert (layout["type"], first_frame["type"]) == ("layout", "first_frame")
        assert layout["data"]["interface"] == "standard", (
            "the profile that the terms of the visit fix"
        )
        await cockpit.close()


async def test_velocities_end_with_three_zeros_when_the_controller_is_released():
    async with RobotSocket() as server:
        cockpit = await at_the_wheel(server)
        assert server.all("command/velocity") == []
        cockpit.steer(SpeedSetting(0.4, 0.1))
        await server.until(lambda: len(server.all("command/velocity")) >= 3)
        cockpit.steer(STAND)
        await server.until(
            lambda: (
                [one["linear"] for one in server.all("command/velocity")][-3:] == [0.0, 0.0, 0.0]
            )
        )
        beats = len(server.all("command/heartbeat"))
        await server.until(lambda: len(server.all("command/heartbeat")) >= beats + 3)
        sent = server.all("command/velocity")
        assert [one["linear"] for one in sent].count(0.0) == 3
        assert [one["seq"] for one in sent] == list(range(1, len(sent) + 1))
        assert all(
            (one["session"], one["epoch"], one["method"]) == ("s1", 3, "keyboard") for one in sent
        )
        assert sent[0]["frame"] > 1000.0
        await cockpit.close()


async def test_heartbeats_are_echoed_and_give_the_round_trip():
    async with RobotSocket() as server:
        cockpit = await at_the_wheel(server)
        await server.until(lambda: server.all("command/heartbeat"))
        mine = server.all("command/heartbeat")[-1]
        await server.say(
            "heartbeat",
            Heartbeat(
                n=7,
                stamp=50.0,
                echoes=({"peer": "p1", "n": mine["n"], "stamp": mine["stamp"], "received": 49.99},),
            ),
        )
        await server.until(lambda: server.all("command/heartbeat")[-1].get("echo"))
        assert server.all("command/heartbeat")[-1]["echo"]["n"] == 7
        assert 0.0 <= cockpit.view.round_trip < 5.0
        await cockpit.close()


async def test_page_that_lost_its_network_resumes_its_session():
    async with RobotSocket() as server:
        cockpit = await at_the_wheel(server)
        await cockpit.lose_network()
        await cockpit.come_back()
        assert await cockpit.until(lambda: cockpit.view.granted, patient(5.0))
        assert server.connections == 2
        assert server.all("session/take") == [{}, {"session": "s1", "peer": "p1"}]
        await cockpit.close()


async def test_close_code_of_the_server_is_kept():
    async with RobotSocket() as server:
        cockpit = await at_the_wheel(server)
        await server.socket.close(protocol.REPLACED)
        assert not await cockpit.until(lambda: cockpit.view.ended, patient(5.0))
        assert cockpit.closed == protocol.REPLACED
        await cockpit.close()


async def test_invalid_frames_from_the_server_are_ignored():
    async with RobotSocket() as server:
        cockpit = await at_the_wheel(server)
        for frame in ("state\n{}", "nothing", "what\n{}", b"picture\nshort", "session/task\n[]"):
            await server.socket.send(frame)
        await server.say(
            "session/task", protocol.Task(session="s1", stamp=1.0, cue="leave_station", number=1)
        )
        assert await cockpit.until(lambda: cockpit.view.task.cue == "leave_station", patient(5.0))
        await cockpit.close()


async def test_bot_that_leaves_the_queue_sends_a_leave_and_no_velocity(monkeypatch):
    async with RobotSocket(queued=True) as server:
        drive = BotDrive(
            Browser(server.url),
            {"socket": "/ws/", "robot": "giraff", "floorplan": "/"},
            Persona(0, 1),
            Ending.LEAVES_QUEUE,
        )
        await drive.cockpit.connect()
        monkeypatch.setattr("experiments.bots.drive.ASK_AGAIN", 0.3)
        assert not await drive._wait_for_turn()
        await server.until(lambda: server.all("session/leave"))
        assert server.all("command/velocity") == []
        await drive.cockpit.close()


def about_to(server, ending):
    return BotDrive(
        Browser(server.url),
        {"socket": "/ws/", "robot": "giraff", "floorplan": "/"},
        Persona(0, 1),
        ending,
    )


MIDWAY = protocol.Task(session="s1", stamp=1.0, passed=(1, 2))


async def midway(drive):
    await drive.cockpit.connect()
    drive.cockpit.take()
    assert await drive.cockpit.until(lambda: drive.view.granted and drive.view.frames, patient(5.0))
    drive.view.task = MIDWAY
    return drive


async def test_a_bot_without_a_connection_sends_no_heartbeat_and_no_image_request():
    async with RobotSocket() as server:
        drive = about_to(server, Ending.GETS_NO_CONNECTION)
        await drive.cockpit.connect()
        drive.cockpit.take()
        assert await drive.cockpit.until(lambda: drive.view.granted, patient(5.0))
        await asyncio.sleep(3 * BEAT)
        assert [suffix for suffix, _ in server.heard] == ["session/take"]
        await drive.cockpit.close()


@pytest.mark.parametrize("ending", [Ending.RELOADS_PAGE, Ending.OPENS_SECOND_PAGE])
async def test_another_page_takes_over_the_session_by_its_id_alone(ending):
    async with RobotSocket() as server:
        drive = await midway(about_to(server, ending))
        first = drive.cockpit
        assert not await drive._act_out_ending()
        assert server.connections == 2
        assert server.all("session/take")[-1] == {"session": "s1", "takeover": True}
        assert drive.cockpit is not first
        assert drive.view.granted
        drive.view.task = MIDWAY
        assert not await drive._act_out_ending(), "it happens once"
        assert server.connections == 2
        await drive.cockpit.close()


async def test_a_bot_that_presses_stop_sends_no_velocity_after_it(monkeypatch):
    monkeypatch.setattr("experiments.bots.drive.SURPRISE", 0.3)
    async with RobotSocket() as server:
        drive = await midway(about_to(server, Ending.PRESSES_STOP))
        drive.cockpit.steer(SpeedSetting(0.4, 0.0))
        await server.until(lambda: len(server.all("command/velocity")) >= 2)
        assert not await drive._act_out_ending()
        (stop,) = server.all("command/action")
        assert stop["type"] == "stop"
        assert all(
            one["linear"] == 0.0
            for one in server.all("command/velocity")
            if one["seq"] > stop["seq"]
        )
        await drive.cockpit.close()


async def test_a_bot_that_retakes_a_photo_keeps_the_second_one():
    async with RobotSocket() as server:
        drive = await midway(about_to(server, Ending.TAKES_PHOTO_AGAIN))
        driver = Driver(load_site("office").plan, Guide(AT_CENTRE, {}), STAND)
        for photo in ("one", "one", "two"):
            drive.view.task = protocol.Task(
                session="s1", stamp=1.0, cue="photo_review", window="review", photo=photo
            )
            drive._answer("keep", driver)

        def answers():
            events = (one for one in server.all("page/event") if one["type"] == "photo_answer")
            return [(one["data"]["id"], one["data"]["choice"]) for one in events]

        await server.until(lambda: len(answers()) >= 2)
        assert answers() == [("one", "again"), ("two", "keep")]
        await drive.cockpit.close()


async def test_unreachable_site_raises_oserror():
    cockpit = Cockpit(Browser("http://127.0.0.1:9"), "/ws/robots/giraff/", "keyboard")
    with pytest.raises(OSError):
        await cockpit.connect()
