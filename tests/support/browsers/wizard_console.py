"""The page of a hidden operator as the server sees it: a WebSocket through the application."""

import msgspec

from sessions.wizard import protocol
from sessions.wizard.operators import OperatedSession
from sessions.wizard.script import Script
from tests.support.browsers.pages import Page, decode


class Operators:
    """An app in which `users`, or without them every user, operate every session."""

    def __init__(self, script=None, users=None):
        self.script, self.users = script or Script(language="en", stages=()), users

    def may_operate(self, user, _robot):
        return self.users is None or user.pk in self.users

    def operated(self, user, _session):
        operated = OperatedSession("P1", "", is_blind=True, script=self.script)
        return operated if self.may_operate(user, None) else None


class Console(Page):
    """Use with `async with`; without a user it is logged out."""

    address = "/ws/robots/{}/wizard/"

    async def open(self):
        self.frames = []
        return await super().open()

    def read(self, frame):
        self.frames.append(frame)
        suffix, _, payload = frame.partition("\n")
        kind = protocol.TO_PAGE.get(suffix)
        return suffix, msgspec.json.decode(payload, type=kind) if kind else decode(frame)[1]

    async def operate(self):
        scene = await self.expect("wizard/session", lambda scene: scene.session)
        await self.say("wizard/take", protocol.TakeOver(session=scene.session))
        return scene, await self.expect("wizard/granted")
