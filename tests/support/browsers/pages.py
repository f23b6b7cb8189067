"""A visitor's page as the server sees it: a WebSocket through the site's whole ASGI application."""

import asyncio
import contextlib
import uuid

import msgspec
from asgiref.sync import sync_to_async
from channels.testing import WebsocketCommunicator
from django.conf import settings
from django.test import Client

from robots.api import codec, picture, topics
from robots.api.messages import Stop
from sessions import protocol
from tests.support.patience import patient, until

SECONDS = 5.0
ORIGIN = "http://127.0.0.1"
FIREFOX = "Mozilla/5.0 (X11; Linux x86_64; rv:153.0) Gecko/20100101 Firefox/153.0"


def cookie_of(user):
    """Return the value of a session cookie that is signed in."""
    client = Client()
    client.force_login(user)
    return client.cookies[settings.SESSION_COOKIE_NAME].value


def decode(frame):
    """Return (suffix, message) of a frame for pages: of sessions/protocol.py or the Robot API, or
    of a binary frame, a picture, whose message is (stamp, JPEG).
    """
    if isinstance(frame, bytes):
        suffix, _, payload = frame.partition(b"\n")
        return suffix.decode(), picture.unpack(payload)
    suffix, _, payload = frame.partition("\n")
    kind = protocol.TO_PAGE.get(suffix)
    if kind is not None:
        return suffix, msgspec.json.decode(payload, type=kind)
    assert suffix in {*topics.TO_PAGE, "words", "receipt", "pointer"}, suffix
    return suffix, codec.decode(suffix, payload, "from_robot")


class Expecting:
    """A test's page, which sends and awaits messages. A subclass has `say_frame`, `next`, which
    receives a message and adds it to `seen`, and `PATIENCE` in seconds.
    """

    PATIENCE = 2 * SECONDS

    async def expect(self, wanted, is_right=lambda _: True):
        """Return the next message of a suffix that is right, however many others arrive."""
        try:
            async with asyncio.timeout(patient(self.PATIENCE)):
                while True:
                    suffix, message = await self.next()
                    if suffix == wanted and is_right(message):
                        return message
        except TimeoutError:
            raise AssertionError(f"no {wanted}; the last were {self.seen[-5:]}") from None

    async def denied(self):
        """Return the suffix of the next denied request, and why it was denied."""
        denied = await self.expect("denied")
        return denied.suffix, denied.reason

    async def say(self, suffix, message):
        await self.say_frame(codec.encode_frame(suffix, message))

    async def take(self, **message):
        await self.say("session/take", protocol.Take(**message))
        self.granted = await self.expect("session/granted")
        return self.granted

    async def queue(self):
        """Ask for the robot while it is taken."""
        await self.say("session/take", protocol.Take())
        return await self.expect("session/queued")

    async def observe(self):
        await self.say("session/observe", protocol.Observe())
        return await self.expect("session/observing")


class Page(Expecting):
    """Use with `async with`; received messages are kept in `seen`."""

    address = "/ws/robots/{}/"

    def __init__(self, robot, user=None, *, origin=ORIGIN, cookie=None):
        self.robot, self.user, self.origin, self.cookie = robot, user, origin, cookie
        self.seen = []

    async def __aenter__(self):
        assert await self.open()
        return self

    async def __aexit__(self, *_error):
        await self.close()

    async def open(self):
        from telepresence_site.asgi import application

        headers = {"host": "127.0.0.1", "user-agent": FIREFOX}
        if self.origin is not None:
            headers["origin"] = self.origin
        if cookie := await self.cookie_header():
            headers["cookie"] = cookie
        pairs = [(name.encode(), value.encode()) for name, value in headers.items()]
        address = self.address.format(self.robot)
        self.socket = WebsocketCommunicator(application, address, headers=pairs)
        self.accepted, self.code = await self.socket.connect(timeout=patient(SECONDS))
        return self.accepted

    async def cookie_header(self):
        if self.user is not None and self.cookie is None:
            self.cookie = await sync_to_async(cookie_of)(self.user)
        return self.cookie and f"{settings.SESSION_COOKIE_NAME}={self.cookie}"

    async def close(self):
        with contextlib.suppress(asyncio.CancelledError):
            await self.socket.disconnect(timeout=patient(SECONDS))

    async def say_frame(self, frame):
        kind = "text_data" if isinstance(frame, str) else "bytes_data"
        await self.socket.send_to(**{kind: frame})

    async def next(self):
        self.seen.append(self.read(await self.socket.receive_from(timeout=patient(SECONDS))))
        return self.seen[-1]

    def read(self, frame):
        return decode(frame)

    async def closed(self):
        """Return the code with which the server closes."""
        while True:
            output = await self.socket.receive_output(timeout=patient(SECONDS))
            if output["type"] == "websocket.close":
                return output["code"]
            self.seen.append(self.read(output.get("text") or output["bytes"]))

    def told(self, suffix):
        return [message for seen, message in self.seen if seen == suffix]

    async def settle(self, bridge):
        """Wait until all messages sent so far are processed, by sending a stop, which always
        passes.
        """
        mark = Stop(action_id=uuid.uuid4().hex, stamp=0.0)
        await self.say("command/action", mark)
        await until(lambda: any(stop.action_id == mark.action_id for _, stop in bridge.stops))
        bridge.stops = [entry for entry in bridge.stops if entry[1].action_id != mark.action_id]


class Display(Page):
    """A page of the robot's screen."""

    address = "/ws/robots/{}/screen/"

    def __init__(self, key, robot="giraff"):
        super().__init__(robot)
        self.key = key

    async def cookie_header(self):
        from robots import screens  # benchmarks import this file without Django

        return f"{screens.cookie_of(self.robot)}={self.key}"
