"""Two web processes, PostgreSQL, Redis, the system's Mosquitto and nginx with TLS: pages work with
either process.
"""

import asyncio
import contextlib
import json
import signal
import time

import aiomqtt
import pytest
from django.contrib.staticfiles.storage import staticfiles_storage
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.protocol import State

from robots.api import topics
from sessions import protocol
from sessions.audience.audience import BEAT_SECONDS
from sessions.audience.board import HAND_SECONDS
from tests.support import words
from tests.support.browsers.pages import Expecting, decode
from tests.support.patience import patient, until
from tests.support.programs.server import running_server
from tests.support.sessions.recorder_rig import ScriptedRobot
from tests.support.sessions.site import wait_for

pytestmark = [pytest.mark.broker, pytest.mark.postgres]
SECONDS = 10.0
WEB = ("web-0", "web-1")
DRIVER = 'telepresence_pages{standing="driver"}'


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with running_server(tmp_path_factory.mktemp("server")) as server:
        yield server


class Tab(Expecting):
    """A page's WebSocket through the proxy."""

    def __init__(self, server, name):
        self.server, self.name, self.seen = server, name, []
        self.cookie = server.site.sign_in(name)

    async def __aenter__(self):
        await self.open()
        return self

    async def __aexit__(self, *_):
        await self.socket.close()

    async def open(self):
        """Connect; the proxy avoids a dead web process at the second attempt at the latest."""
        headers = {"Cookie": f"sessionid={self.cookie}", "X-Forwarded-For": "8.8.8.8"}
        url = self.server.url.replace("https", "wss") + "/ws/robots/giraff/"
        async with asyncio.timeout(patient(SECONDS)):
            while True:
                try:
                    options = {"ssl": self.server.tls, "origin": self.server.url, "proxy": None}
                    self.socket = await connect(url, additional_headers=headers, **options)
                except (InvalidStatus, OSError):
                    await asyncio.sleep(0.1)
                else:
                    break
        self.hello = await self.expect("hello")

    async def say_frame(self, frame):
        await self.socket.send(frame)

    async def next(self):
        self.seen.append(decode(await self.socket.recv()))
        return self.seen[-1]

    async def listen(self, seconds):
        """Read for a while, as a page does: a page that reads nothing is disconnected."""
        with contextlib.suppress(TimeoutError, ConnectionClosed):
            async with asyncio.timeout(seconds):
                while True:
                    await self.socket.recv()


@contextlib.asynccontextmanager
async def online_robot(server):
    login = ("giraff", server.token)
    async with ScriptedRobot("giraff", server.site.mqtt_url, login=login, period=0.1) as robot:
        await robot.publish("factsheet", words.factsheet())
        online = lambda: server.figure("web-0", 'telepresence_robot_online{robot="giraff"}')
        await asyncio.to_thread(wait_for, lambda: online() == 1, SECONDS, "the robot's presence")
        yield robot


def each_serves_one(server):
    """Tell whether each web process serves one page."""
    return [server.figure(web, 'telepresence_websockets{kind="drive"}') for web in WEB] == [1, 1]


@pytest.mark.nightly
async def test_hands_and_questions_reach_the_driver_on_the_other_process(server):
    async with online_robot(server), Tab(server, "ada") as ada, Tab(server, "bob") as bob:
        assert each_serves_one(server)
        await ada.take()
        await bob.observe()
        await bob.expect("audience", lambda audience: audience.open)
        await bob.say("audience/hand", protocol.RaiseHand(raised=True))
        await bob.say("audience/ask", protocol.AskQuestion(text="Why?"))
        seen = await ada.expect("audience", lambda audience: audience.questions)
        (question,) = seen.questions
        assert (seen.names, question.who) == (("bob",), "bob")
        mark = protocol.MarkQuestion(question=question.id, state="answering")
        await ada.say("audience/mark", mark)
        await bob.expect("audience", lambda one: one.questions[0].state == "answering")
        await bob.socket.close()
        await ada.expect("audience", lambda audience: audience.hands == 0)
        await ada.say("session/leave", protocol.Leave())
        await ada.expect("session/ended")


@pytest.mark.soak
async def test_raised_hand_survives_the_kill_of_a_web_process(server):
    async with online_robot(server), contextlib.AsyncExitStack() as stack:
        tabs = [Tab(server, name) for name in ("ada", "bob", "cy", "dee", "eve")]
        ada, *watchers = [await stack.enter_async_context(tab) for tab in tabs]
        await ada.take()
        for watcher in watchers:
            await watcher.observe()
            await watcher.expect("audience", lambda audience: audience.open)
            await watcher.say("audience/hand", protocol.RaiseHand(raised=True))
        await ada.expect("audience", lambda audience: audience.hands == len(watchers))
        (dead,) = (web for web in WEB if server.figure(web, DRIVER) == 0)
        server.site.stop(dead, signal.SIGKILL)
        await asyncio.gather(*(watcher.listen(1.0) for watcher in watchers))
        alive = [watcher for watcher in watchers if watcher.socket.state is State.OPEN]
        back, *gone = (watcher for watcher in watchers if watcher not in alive)
        await back.open()
        await back.say("session/observe", protocol.Observe())
        await back.expect("audience", lambda audience: audience.raised)
        await back.say("audience/hand", protocol.RaiseHand(raised=True))
        seconds = HAND_SECONDS + 2 * BEAT_SECONDS
        await asyncio.gather(*(tab.listen(seconds) for tab in (ada, back, *alive)))
        for watcher in alive:
            await watcher.say("audience/hand", protocol.RaiseHand(raised=False))
        assert gone, "an observer does not come back"
        await ada.expect("audience", lambda audience: audience.names == (back.name,))
        server.site.start(dead)
        port = server.ports[dead]
        await until(lambda: server.site.listening(port), "the process that was killed")
        await ada.say("session/leave", protocol.Leave())
        await ada.expect("session/ended")


@pytest.mark.nightly
async def test_two_visitors_on_two_processes_share_one_robot(server):
    async with online_robot(server) as robot, Tab(server, "ada") as ada, Tab(server, "bob") as bob:
        assert each_serves_one(server)

        driving = await ada.take()
        await until(lambda: robot.session == driving.session, "the robot has its driver")
        await bob.say("session/observe", protocol.Observe())
        await bob.expect("state", lambda state: state.session == driving.session)
        await bob.expect("room", lambda room: room.driver == "ada" and room.driving)

        await ada.say("command/velocity", words.velocity(stamp=time.time()))
        await until(lambda: robot.driven, "the command arrives")
        command = robot.driven[-1]
        assert (command.session, command.epoch) == (driving.session, driving.epoch)
        await bob.say("command/velocity", words.velocity(seq=2, stamp=time.time()))
        assert (await bob.expect("denied")).suffix == "command/velocity"

        assert (await bob.queue()).place == 1
        await ada.say("session/leave", protocol.Leave())
        await bob.expect("session/offered")
        second = await bob.take()
        assert second.epoch > driving.epoch
        await until(lambda: robot.session == second.session, "the robot has its next driver")

        # Bob's web process is killed: his page reconnects to the other one, to the same drive.
        mine = next(web for web in WEB if server.figure(web, DRIVER) == 1)
        server.site.processes[mine].kill()
        server.site.processes.pop(mine).wait()
        with pytest.raises((ConnectionClosed, AssertionError)):
            await bob.expect("never")
        await bob.open()
        again = await bob.take(session=second.session, peer=second.peer)
        assert (again.session, again.epoch) == (second.session, second.epoch)
        assert again.resumed
        count = len(robot.driven)
        await bob.say("command/velocity", words.velocity(seq=7, stamp=time.time()))
        await until(lambda: len(robot.driven) > count, "a command by the other process")
        await bob.say("session/leave", protocol.Leave())
        await bob.expect("session/ended")
    stored = server.site.django(
        "from sessions.models import Session, StateChunk;"
        "print(sum(chunk.count for chunk in StateChunk.objects.all()),"
        " *sorted({s.device['network'] for s in Session.objects.all()}))"
    )
    states, *networks = stored.split()
    assert int(states) > 0
    assert networks == ["127.0.0.0/24"], "a forged address is ignored"


async def test_page_over_plain_http_opens_no_socket(server):
    headers = {"Cookie": f"sessionid={server.site.sign_in('ada')}"}
    ask = {"ssl": server.tls, "additional_headers": headers, "proxy": None}
    url = server.url.replace("https", "wss") + "/ws/robots/giraff/"
    with pytest.raises(InvalidStatus, match="403"):
        await connect(url, origin=server.url.replace("https", "http"), **ask)
    async with connect(url, origin=server.url, **ask) as page:
        assert decode(await page.recv())[0] == "hello"


async def test_robot_with_web_access_only_reaches_the_broker_behind_the_proxy(server):
    async def subscribed(password):
        web = {"transport": "websockets", "websocket_path": "/mqtt", "tls_context": server.tls}
        login = {"username": "giraff", "password": password, "timeout": patient(SECONDS)}
        async with aiomqtt.Client("localhost", server.ports["https"], **login, **web) as robot:
            return await robot.subscribe(topics.of("giraff", "lease"), qos=1)

    assert [code.value for code in await subscribed(server.token)] == [1]
    with pytest.raises(aiomqtt.MqttError):
        await subscribed("another")


def test_proxy_uses_tls_and_does_not_publish_the_metrics(server):
    plain, hashed = "css/_global.css", staticfiles_storage.stored_name("css/_global.css")
    assert server.get(f"{server.url}/metrics")[0] == 404
    forged = {"X-Request-ID": "forged-request-id"}
    status, headers, text = server.get(f"{server.url}/readyz", **forged)
    assert (status, json.loads(text)["channel_layer"]) == (200, "ok")
    assert headers["x-request-id"] != "forged-request-id"
    assert "immutable" in server.get(f"{server.url}/static/{hashed}")[1]["cache-control"]
    assert "immutable" not in server.get(f"{server.url}/static/{plain}")[1].get("cache-control", "")
    status, headers, _ = server.get(f"{server.url}/accounts/login/")
    assert status == 200
    assert "max-age=" in headers["strict-transport-security"]
    assert "Secure" in headers["set-cookie"]


@pytest.mark.nightly
def test_every_log_line_is_json_and_names_its_request(server):
    server.get(f"{server.url}/about/")

    def asked():  # the line is written after the answer
        lines = [
            json.loads(line)
            for web in WEB
            for line in server.site.log(web).splitlines(keepends=True)
            if line.endswith("\n")
        ]
        done = [line for line in lines if line["event"] == "request_done"]
        return [line for line in done if line["route"] == "about/"]

    wait_for(asked, SECONDS, "the request's line")
    assert all(len(line["request"]) == 32 for line in asked()), "nginx's own ids"
    lines = server.site.log("session-manager").splitlines()
    assert not [line for line in lines if not line.startswith("{")]
