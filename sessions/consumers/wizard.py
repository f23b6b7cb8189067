"""The WebSocket of a hidden operator; wizard_authorization.py has its permissions, wizard_relay.py
the messages to it.

A step is sent to the robot before it is recorded, so that the record does not delay the robot. When
the socket closes for any reason, the robot is stopped until an operator takes over again.
"""

import asyncio
import secrets
import time
import uuid
from typing import Any

import msgspec
import structlog
from django.db import DatabaseError, InterfaceError
from django.utils import timezone

from robots.api.errors import Rejection
from robots.api.messages import Action, Bye, Lease, Message, Say
from robots.bridge.delivery import NOTICE, ReceivedMessage
from robots.ice import IceCredentials
from robots.models import Robot
from robots.process import log_ids
from sessions import page_channel, protocol as pages
from sessions.consumers import queries, wizard_relay
from sessions.consumers.authorization import FrameRefused, Publish
from sessions.consumers.database import query
from sessions.consumers.robot_page import RobotPageConsumer
from sessions.consumers.wizard_authorization import SCRIPT, WizardAuthorization
from sessions.wizard import leases, operators, protocol
from sessions.wizard.operators import OperatedSession
from sessions.wizard.script import Press, ScriptProgress, action_of

log = structlog.stdlib.get_logger(__name__)

HAND_PAUSE = 2.0  # s without a velocity by hand after which the next is a new deviation
TURN_SECONDS = 30.0  # longest duration of a step that turns the robot


class WizardConsumer(RobotPageConsumer):
    """One operator's page at one robot."""

    authorization: WizardAuthorization

    # --- from connecting to closing ---------------------------------------------------------------

    async def _enter(self) -> int | None:
        self.user, self.name = self.scope["user"], self.scope["url_route"]["kwargs"]["robot"]
        log_ids.bind(lambda: {"robot": self.name})  # until the end of this socket's own task
        if not self.user.is_authenticated:
            return pages.SIGNED_OUT
        self.robot = await query(_robot_for, self.user, self.name)
        return pages.NOT_ALLOWED if self.robot is None else None

    def _register(self) -> None:
        self._join()
        servers = IceCredentials(str(self.user.pk))
        self.authorization = WizardAuthorization(secrets.token_urlsafe(12), servers)
        self.turn = asyncio.Lock()
        self.shown: protocol.SessionToOperate | None = None
        self.at: tuple[str, OperatedSession] | None = None  # the session at the robot
        self.progress: ScriptProgress | None = None
        self.hand_at = float("-inf")
        self.changed = asyncio.Event()
        hello = protocol.WizardHello(
            peer=self.authorization.peer,
            stamp=time.time(),
            robot=self.name,
            online=self.known.online is True,
            ice_servers=servers(),
        )
        self.sender.post("wizard/hello", hello)
        self.changed.set()
        self._launch(self._keep_looking(self.changed, self._look_in_turn, self._is_welcome))
        groups = (page_channel.visitor_group(self.user.pk),)
        self._launch(page_channel.listen(groups, lambda _: self._launch(self._check_again())))
        log.info("wizard_joined", robot=self.name)

    async def _clean_up(self) -> None:
        """Stop the robot, however the connection ended."""
        authorization = self.authorization
        stop = authorization.last_stop(uuid.uuid4().hex, time.time(), self.known.lease)
        if stop is not None:
            self.bridge.send_stop(self.name, stop)
        self._signal(Bye(reason="left"))
        await super()._clean_up()
        self._unfollow()
        session = authorization.session
        authorization.release()
        if session is not None:
            await asyncio.shield(self._release(session, authorization.peer, leases.LOST))
        log.info("wizard_left", robot=self.name, refused=dict(authorization.refused))

    async def _release(self, session: str, peer: str, kind: str) -> None:
        now = timezone.now()
        lease = await query(leases.release, session, peer, now)
        if lease is not None:
            self.bridge.publish_lease(self.name, lease)
            await self._note(session, kind)

    # --- frames of the page -----------------------------------------------------------------------

    def _publish(self, publish: Publish) -> None:
        self._notice_hand(publish.message)
        super()._publish(publish)

    def _notice_hand(self, message: Any) -> None:
        """Note that the operator drives by hand, once for each time."""
        method = getattr(message, "method", SCRIPT)
        if method == SCRIPT or (message.linear == 0.0 and message.angular == 0.0):
            return
        now = time.monotonic()
        if now - self.hand_at > HAND_PAUSE:
            self._launch(self._note(self.authorization.session, leases.BY_HAND, method=method))
        self.hand_at = now

    def _ask(self, suffix: str, verb: Message) -> None:
        match verb:
            case protocol.TakeOver():
                self._launch(self._take(verb), suffix)
            case protocol.StopOperating():
                self._launch(self._stop_operating(), suffix)
            case protocol.BeginStep():
                self._step(verb)
            case protocol.FreeLine():
                self._line(verb)
            case protocol.Reached(action_id=key, latency=latency):
                session, seconds = self.authorization.session, round(latency, 4)
                self._launch(self._note(session, leases.REACHED, id=key, latency=seconds))

    # --- control of the robot ---------------------------------------------------------------------

    async def _take(self, ask: protocol.TakeOver) -> None:
        """Give the operator control of the session that this page shows.

        `turn` serialises it with releasing. The session may have ended since the page showed it, or
        another operator may have it; the lease's row decides, and the page receives `wizard/lost`.
        """
        authorization = self.authorization
        async with self.turn:
            operated = self.at[1] if self.at is not None and self.at[0] == ask.session else None
            if operated is None:
                self.sender.post("wizard/lost", protocol.Lost(reason="ended"))
                return
            taken = await query(
                leases.take,
                ask.session,
                self.user,
                authorization.peer,
                timezone.now(),
                takeover=ask.takeover,
            )
            if not isinstance(taken, Lease):
                self.sender.post("wizard/lost", protocol.Lost(reason=taken))
                return
            authorization.operate(ask.session, taken.wizard_epoch, by_hand=operated.script.by_hand)
            # before `wizard/granted`, so that the robot has the lease when commands arrive
            self.bridge.publish_lease(self.name, taken)
            granted = protocol.Operating(session=ask.session, epoch=taken.wizard_epoch)
            self.sender.post("wizard/granted", granted)
            await self._note(ask.session, leases.TOOK, blind=operated.is_blind)
        self.changed.set()

    async def _stop_operating(self) -> None:
        authorization = self.authorization
        async with self.turn:
            session = authorization.session
            authorization.release()
            if session is not None:
                await self._release(session, authorization.peer, leases.LEFT)
        self.changed.set()

    # --- the script -------------------------------------------------------------------------------

    def _step(self, ask: protocol.BeginStep) -> None:
        """Begin a step: send the robot its action, or permit the velocities of the page."""
        progress = self.progress
        known = progress is not None and any(ask.step == one.key for one in progress.script.steps)
        if progress is None or not known or not self.authorization.drives(self.known.lease):
            refused = protocol.StepBegun(
                step=ask.step, action_id=ask.action_id, reason="not_driver" if known else "unknown"
            )
            self.sender.post("wizard/begun", refused)
            return
        now = time.time()
        press = progress.judge(ask.step, now)
        assert press is not None
        reason = self._begin(press, ask)
        if not reason:  # a step that was not sent may be pressed again
            progress.press(ask.step, now)
        begun = protocol.StepBegun(
            step=ask.step,
            action_id=ask.action_id,
            deviation=press.deviation,
            skipped=press.skipped,
            reason=reason,
        )
        self.sender.post("wizard/begun", begun)
        data: dict[str, Any] = {"step": ask.step, "id": ask.action_id, "deviation": press.deviation}
        data |= {"skipped": press.skipped, "reason": reason}
        self._launch(self._note(self.authorization.session, leases.STEP, **data))

    def _begin(self, press: Press, ask: protocol.BeginStep) -> str:
        """Send the action of a step; return why it could not be sent, or nothing."""
        step = press.step
        if step.sends_velocities:
            seconds = step.drive.seconds + 1.0 if step.drive is not None else TURN_SECONDS
            self.authorization.script_until = time.monotonic() + seconds
            return ""
        assert self.progress is not None
        language = self.progress.script.language
        action = action_of(step, language, action_id=ask.action_id, stamp=ask.stamp)
        assert action is not None  # only steps that the page drives have none
        return self._send_action(action)

    def _send_action(self, action: Action) -> str:
        try:
            stamped = self.authorization.stamp_action(action, self.known.lease)
        except FrameRefused as refused:
            return str(refused)
        online = self.known.online is not False
        sent = online and self.bridge.send(self.name, "command/action", stamped)
        return "" if sent else "robot_unreachable"

    def _line(self, ask: protocol.FreeLine) -> None:
        """Have the robot speak a text that is not in the script, which is a deviation."""
        language = self.progress.script.language if self.progress is not None else ""
        action = Say(
            action_id=ask.action_id,
            stamp=ask.stamp,
            text=ask.text,
            language=language,
            aloud=ask.aloud,
        )
        reason = self._send_action(action)
        begun = protocol.StepBegun(step="free", action_id=ask.action_id, reason=reason)
        self.sender.post("wizard/begun", begun)
        if not reason:
            data = {"id": ask.action_id, "text": ask.text, "aloud": ask.aloud}
            self._launch(self._note(self.authorization.session, leases.LINE, **data))

    async def _note(self, session: str | None, kind: str, **data: Any) -> None:
        if session is None:
            return
        try:
            await query(leases.note, session, kind, self.user, timezone.now(), **data)
        except (DatabaseError, InterfaceError) as error:
            log.error("wizard_not_recorded", session=session, event_type=kind, reason=str(error))

    # --- messages to the page ---------------------------------------------------------------------

    def handle_message(self, inbound: ReceivedMessage) -> None:
        """Handle a message of the robot, or a notice of the participant's session."""
        if inbound.suffix == NOTICE:
            self._handle_notice(str(inbound.frame))
        elif inbound.suffix == "lease":
            self._lease_changed(inbound.message)
        elif (
            not self._handle_connection(inbound)
            and (out := wizard_relay.for_wizard(inbound, self.authorization.peer)) is not None
        ):
            self.sender.put(out)

    def _handle_notice(self, frame: str) -> None:
        if self.progress is None or not self.progress.script.participant_view:
            return
        try:
            view = wizard_relay.participant_view(frame)
        except Rejection as rejection:
            log.error("notice_rejected", robot=self.name, reason=str(rejection))
            return
        if view is not None:
            self.sender.post("wizard/participant", view)

    def _lease_changed(self, lease: Lease | None) -> None:
        self.changed.set()
        authorization, session = self.authorization, self.authorization.session
        if session is None or authorization.drives(lease):
            return
        is_same = lease is not None and lease.session == session
        if is_same and lease is not None and lease.wizard_epoch < authorization.epoch:
            return  # an older copy
        authorization.release()
        self.sender.post("wizard/lost", protocol.Lost(reason="taken" if is_same else "ended"))

    # --- regular work -----------------------------------------------------------------------------

    async def _look_in_turn(self) -> None:
        async with self.turn:
            await self._look()

    async def _is_welcome(self) -> bool:
        key = self.scope["session"].session_key
        return await query(_is_welcome, key, self.user, self.name)

    async def _check_again(self) -> None:
        """End the page if its user may no longer operate the robot."""
        if not await self._is_welcome():
            self.sender.end(pages.NOT_ALLOWED)

    async def _look(self) -> None:
        scene = await query(_scene, self.user, self.robot, self.authorization.peer)
        if scene is None:
            self._unfollow()
            self.at = self.progress = None
            shown = protocol.SessionToOperate()
        else:
            session, operated, shown = scene
            if self.at is None or self.at[0] != session:
                self._unfollow()
                self.at = (session, operated)
                await self._resume(session, operated)
                self.bridge.follow(session, self)
        if self.progress is not None:
            done = tuple(dict.fromkeys(self.progress.done))
            shown = msgspec.structs.replace(shown, done=done)
        if shown != self.shown:
            self.shown = shown
            self.sender.post("wizard/session", shown)

    async def _resume(self, session: str, operated: OperatedSession) -> None:
        """Restore the progress of the script from the record, as after a reload of the page."""
        done = await query(leases.steps_done, session)
        self.progress = ScriptProgress(operated.script, time.time())
        for at, key in done:
            self.progress.press(key, at)

    def _unfollow(self) -> None:
        if self.at is not None:
            self.bridge.unfollow(self.at[0], self)


def _robot_for(user: Any, name: str) -> Robot | None:
    robot = Robot.objects.filter(name=name).first()
    return robot if robot is not None and operators.may_operate(user, robot) else None


def _is_welcome(session_key: str | None, user: Any, name: str) -> bool:
    current = queries.signed_in(session_key, user)
    return current is not None and _robot_for(current, name) is not None


def _scene(
    user: Any, robot: Robot, peer: str
) -> tuple[str, OperatedSession, protocol.SessionToOperate] | None:
    """Return the session at a robot that this user operates, for a page with this peer id; None
    without one.
    """
    session = leases.session_at(robot)
    operated = operators.operated(user, session) if session is not None else None
    if session is None or operated is None:
        return None
    held_by = leases.operator_of(session)
    shown = protocol.SessionToOperate(
        session=str(session.pk),
        participant=operated.participant,
        condition="" if operated.is_blind else operated.condition,
        visitor_seen=session.seen_at is not None,
        operator="me" if held_by == peer else "other" if held_by else "",
        script=operated.script,
    )
    return str(session.pk), operated, shown
