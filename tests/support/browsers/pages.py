"""A visitor's page as the server sees it: a WebSocket through the site's whole ASGI application."""

import asyncio
import contextlib
import uuid

import msgspec
from asgiref.sync import sync_to_async
from channels.testing import WebsocketCommunicator
from django.conf import settings
from django.test import Client

from robots import screens
from robots.api import codec, picture, topics
from robots.api.messages import Stop
from sessions import protocol
from tests.support.patience import patient

SECONDS = 5.0
ORIGIN = "http://127.0.0.1"


def cookie_of(user):
    """Return the value of a session cookie that is signed in."""
    client = Client()
    client.force_login(user)
    return client.cookies[settings.SESSION_COOKIE_NAME].value


def decode(frame):
    """Return (suffix, message) of a frame for pages; media and telemetry are of the Robot API, the
    rest of sessions/protocol.py.

    A binary frame is a picture: its message is (stamp, JPEG).
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
    """A test's page, which sends and awaits messages. A subclass has `say_frame`, and `next`, which
    receives a message and adds it to `seen`; `PATIENCE` is in seconds.
    """

    PATIENCE = 2 * SECONDS

    async def expect(self, wanted, is_right=lambda _: True):
        """Return the next message of a suffix that is right; others may come for ever meanwhile."""
        try:
            async with asyncio.timeout(patient(self.PATIENCE)):
                while True:
                    suffix, message = await self.next()
                    if suffix == wanted and is_right(message):
                        return message
        except TimeoutError:
            raise AssertionError(f"no {wanted}; the last were {self.seen[-5:]}") from None

    async def say(self, suffix, message):
        await self.say_frame(codec.encode_frame(suffix, message))

    async def take(self, **message):
        await self.say("session/take", protocol.Take(**message))
        return await self.expect("session/granted")

    async def queue(self):
        """Ask for the robot while it is taken."""
        await self.say("session/take", protocol.Take())
        return await self.expect("session/queued")

    async def observe(self):
        await self.say("session/observe", protocol.Observe())
        return await self.expect("session/observing")


class Page(Expecting):
    """Use with `async with`. What arrives is kept in `seen`; `expect` waits for a suffix, whatever
    comes before it.
    """

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

        headers = [
            (b"host", b"127.0.0.1"),
            (
                b"user-agent",
                b"Mozilla/5.0 (X11; Linux x86_64; rv:153.0) Gecko/20100101 Firefox/153.0",
            ),
        ]
        if self.origin is not None:
            headers.append((b"origin", self.origin.encode()))
        if self.user is not None and self.cookie is None:
            self.cookie = await sync_to_async(cookie_of)(self.user)
        if self.cookie is not None:
            headers.append((b"cookie", f"{settings.SESSION_COOKIE_NAME}={self.cookie}".encode()))
        self.socket = WebsocketCommunicator(
            application, f"/ws/robots/{self.robot}/", headers=headers
        )
        self.accepted, self.code = await self.socket.connect(timeout=patient(SECONDS))
        return self.accepted

    async def close(self):
        with contextlib.suppress(asyncio.CancelledError):
            await self.socket.disconnect(timeout=patient(SECONDS))

    async def say_frame(self, frame):
        await self.socket.send_to(text_data=frame) if isinstance(
            frame, str
        ) else await self.socket.send_to(bytes_data=frame)

    async def next(self):
        self.seen.append(self.read(await self.socket.receive_from(timeout=patient(SECONDS))))
        return self.seen[-1]

    def read(self, frame):
        """Return (suffix, message) of a frame."""
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
        """Wait until everything said so far has been dealt with: a stop, which always passes, comes
        last.
        """
        mark = Stop(action_id=uuid.uuid4().hex, stamp=0.0)
        await self.say("command/action", mark)
        await until(lambda: any(stop.action_id == mark.action_id for _, stop in bridge.stops))
        bridge.stops = [entry for entry in bridge.stops if entry[1].action_id != mark.action_id]


class Display(Page):
    """A page of the robot's screen."""

    def __init__(self, key, robot="giraff"):
        super().__init__(robot)
        self.key = key

    async def open(self):
        from telepresence_site.asgi import application

        cookie = f"{screens.cookie_of(self.robot)}={self.key}".encode()
        headers = [(b"host", b"127.0.0.1"), (b"origin", ORIGIN.encode()), (b"cookie", cookie)]
        self.socket = WebsocketCommunicator(
            application, f"/ws/robots/{self.robot}/screen/", headers=headers
        )
        self.accepted, self.code = await self.socket.connect(timeout=patient(SECONDS))
        return self.accepted


async def until(condition, what=""):
    """Wait until `condition()` is true."""
    async with asyncio.timeout(patient(SECONDS)):
        while not condition():
            await asyncio.sleep(0.005)
