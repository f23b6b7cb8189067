"""The page of a hidden operator as the server sees it: a WebSocket through the application."""

import msgspec
from asgiref.sync import sync_to_async
from channels.testing import WebsocketCommunicator
from django.conf import settings

from sessions.wizard import protocol
from tests.support.browsers.pages import ORIGIN, SECONDS, Page, cookie_of, decode
from tests.support.patience import patient


class Console(Page):
    """Use with `async with`; without a user, nobody has signed in."""

    async def open(self):
        from telepresence_site.asgi import application

        headers = [(b"host", b"127.0.0.1"), (b"origin", ORIGIN.encode())]
        if self.user is not None:
            cookie = await sync_to_async(cookie_of)(self.user)
            headers.append((b"cookie", f"{settings.SESSION_COOKIE_NAME}={cookie}".encode()))
        address = f"/ws/robots/{self.robot}/wizard/"
        self.socket = WebsocketCommunicator(application, address, headers=headers)
        self.accepted, self.code = await self.socket.connect(timeout=patient(SECONDS))
        self.frames = []
        return self.accepted

    def read(self, frame):
        self.frames.append(frame)
        suffix, _, payload = frame.partition("\n")
        kind = protocol.TO_PAGE.get(suffix)
        return suffix, msgspec.json.decode(payload, type=kind) if kind else decode(frame)[1]

    async def operate(self):
        scene = await self.expect("wizard/session", lambda scene: scene.session)
        await self.say("wizard/take", protocol.TakeOver(session=scene.session))
        return scene, await self.expect("wizard/granted")
