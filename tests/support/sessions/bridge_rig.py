"""A real broker and real web servers, a robot that a test speaks for, and pages on real sockets."""

import asyncio
import contextlib
import socket
import tomllib
import uuid

import aiomqtt
from websockets.asyncio.client import connect

from robots.api import codec, topics
from robots.api.messages import Stop
from telepresence_site.serving import APPLICATION, DAPHNE
from tests.support.browsers.pages import Expecting, decode
from tests.support.patience import patient, until
from tests.support.sessions.site import LOOPBACK, Site, wait_for

SECONDS = 10.0


class Rig(Site):
    """A site without session manager and without robots; `giraff` is said to be online."""

    def start_web(self):
        self.prepare()
        self.django(
            "from django.utils import timezone; from robots.models import RobotPresence;"
            " RobotPresence.objects.update(connection='ONLINE', last_seen_at=timezone.now() +"
            " timezone.timedelta(days=1))"
        )
        self.start_broker()
        self.web("web", self.web_port)
        wait_for(self.web_answers, 20, "the web server")

    def web(self, name, port):
        self.start(name, [*DAPHNE, "-b", LOOPBACK, "-p", str(port), APPLICATION])


class RobotDouble:
    """The robot's end of the broker: `got` is what it was sent, as (suffix, message)."""

    def __init__(self, site, name="giraff"):
        self.site, self.name, self.got = site, name, []

    async def __aenter__(self):
        credentials = self.site.var / "credentials" / f"{self.name}.toml"
        token = tomllib.loads(credentials.read_text())["token"]
        self.client = aiomqtt.Client(
            LOOPBACK,
            self.site.mqtt_port,
            username=self.name,
            password=token,
            max_inflight_messages=1000,
            max_queued_outgoing_messages=0,
        )
        self.client.pending_calls_threshold = 10_000
        await self.client.__aenter__()
        inputs = [
            (each, 0)
            for each in topics.subscriptions(self.name)
            if not each.endswith(("/connection", "/floorplan"))
        ]
        await self.client.subscribe(inputs)
        self.reading = asyncio.create_task(self._read())
        return self

    async def __aexit__(self, *_error):
        self.reading.cancel()
        await asyncio.gather(self.reading, return_exceptions=True)
        with contextlib.suppress(aiomqtt.MqttError):
            await self.client.__aexit__(None, None, None)

    async def _read(self):
        with contextlib.suppress(aiomqtt.MqttError):
            async for message in self.client.messages:
                _, suffix = topics.parse(str(message.topic))
                self.got.append(
                    (suffix, codec.decode(suffix, message.payload) if message.payload else None)
                )

    async def say(self, suffix, message, *, qos=1, retain=False):
        await self.client.publish(
            topics.of(self.name, suffix), codec.encode(message), qos=qos, retain=retain
        )

    def commands(self, suffix):
        return [message for sent, message in self.got if sent == suffix]


class SocketPage(Expecting):
    """A page on a real WebSocket. `slow`: its machine takes little and reads nothing until it is
    asked to.
    """

    PATIENCE = 2 * SECONDS

    def __init__(self, site, cookie, *, robot="giraff", port=None, origin="", slow=False):
        self.port = port or site.web_port
        self.url = f"ws://{LOOPBACK}:{self.port}/ws/robots/{robot}/"
        self.options = {
            "origin": f"http://{LOOPBACK}:{self.port}" if origin == "" else origin,
            "additional_headers": {"Cookie": f"sessionid={cookie}"},
            "max_size": None,
            "compression": None,
            "proxy": None,
            "open_timeout": patient(SECONDS),
        }
        self.seen = []
        self.slow = slow

    async def __aenter__(self):
        if self.slow:
            small = socket.socket()
            small.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
            small.setblocking(False)
            await asyncio.get_running_loop().sock_connect(small, (LOOPBACK, self.port))
            # nor an answer to its own pings
            self.options |= {"sock": small, "max_queue": 1, "ping_interval": None}
        self.socket = await connect(self.url, **self.options)
        return self

    async def __aexit__(self, *_error):
        await self.socket.close()

    async def say_frame(self, frame):
        await self.socket.send(frame)

    async def next(self):
        suffix, message = decode(await asyncio.wait_for(self.socket.recv(), patient(SECONDS)))
        self.seen.append((suffix, message))
        return suffix, message

    async def settle(self, robot):
        """Wait until everything said so far has arrived or been refused: a stop comes last, and
        always passes.
        """
        mark = uuid.uuid4().hex
        await self.say("command/action", Stop(action_id=mark, stamp=0.0))
        await until(
            lambda: any(stop.action_id == mark for stop in robot.commands("command/action"))
        )
        robot.got = [
            (suffix, message)
            for suffix, message in robot.got
            if getattr(message, "action_id", "") != mark
        ]
