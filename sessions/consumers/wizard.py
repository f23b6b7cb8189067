"""The WebSocket of a hidden operator: decode, ask, perform. Its rules are in
sessions/consumers/wizard_authorization.py, what it is told in wizard_relay.py.

A step is sent to the robot before anything is written about it, so that the record costs the robot
no time. When the socket ends, however that is, the robot is stopped, and nobody drives until
somebody operates again.
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

from robots import log_ids
from robots.api.errors import Rejection
from robots.api.messages import Action, Bye, Lease, Message, Say
from robots.bridge.delivery import NOTICE, ReceivedMessage
from robots.ice import IceCredentials
from robots.models import Robot
from sessions import page_channel
from sessions import protocol as pages
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
TURN_SECONDS = 30.0  # for which a step that turns the robot may take


class WizardConsumer(RobotPageConsumer):
    """One operator's page at one robot. Until the operator was found to be one there is no room,
    and whatever the page says is ignored.
    """

    authorization: WizardAuthorization | None = None

    # --- coming and going -------------------------------------------------------------------------

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
        self._launch(page_channel.listen(groups, lambda _: self._launch(self._look_again())))
        log.info("wizard_joined", robot=self.name)

    async def _gone(self) -> None:
        """Stop the robot, however the page went."""
        authorization = self.authorization
        assert authorization is not None
        stop = authorization.last_stop(uuid.uuid4().hex, time.time(), self.known.lease)
        if stop is not None:
            self.bridge.send_stop(self.name, stop)
        self._signal(Bye(reason="left"))
        await super()._gone()
        self._unfollow()
        session = authorization.session
        authorization.let_go()
        if session is not None:
            await asyncio.shield(self._release(session, authorization.peer, leases.LOST))
        log.info("wizard_left", robot=self.name, refused=dict(authorization.refused))

    async def _release(self, session: str, peer: str, kind: str) -> None:
        now = timezone.now()
        lease = await query(leases.release, session, peer, now)
        if lease is not None:
            self.bridge.publish_lease(self.name, lease)
            await self._note(session, kind)

    # --- what the page says -----------------------------------------------------------------------

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
            self._launch(self._note(self._session(), leases.BY_HAND, method=method))
        self.hand_at = now

    def _ask(self, suffix: str, verb: Message) -> None:
        authorization = self.authorization
        assert authorization is not None
        match verb:
            case protocol.TakeOver():
                self._launch(self._take(authorization, verb), suffix)
            case protocol.StopOperating():
                self._launch(self._let_go(authorization), suffix)
            case protocol.BeginStep():
                self._step(authorization, verb)
            case protocol.FreeLine():
                self._line(authorization, verb)
            case protocol.Reached(action_id=key, latency=latency):
                self._launch(
                    self._note(self._session(), leases.REACHED, id=key, latency=round(latency, 4))
                )

    # --- the wheel --------------------------------------------------------------------------------

    async def _take(self, authorization: WizardAuthorization, ask: protocol.TakeOver) -> None:
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
            # before the page hears of it, so that the robot knows the operator when commands come
            self.bridge.publish_lease(self.name, taken)
            granted = protocol.Operating(session=ask.session, epoch=taken.wizard_epoch)
            self.sender.post("wizard/granted", granted)
            await self._note(ask.session, leases.TOOK, blind=operated.is_blind)
        self.changed.set()

    async def _let_go(self, authorization: WizardAuthorization) -> None:
        async with self.turn:
            session = authorization.session
            authorization.let_go()
            if session is not None:
                await self._release(session, authorization.peer, leases.LEFT)
        self.changed.set()

    # --- the script -------------------------------------------------------------------------------

    def _step(self, authorization: WizardAuthorization, ask: protocol.BeginStep) -> None:
        """Begin a step: what the robot does by itself is sent, what the page drives is let pass."""
        progress = self.progress
        known = progress is not None and any(ask.step == one.key for one in progress.script.steps)
        if progress is None or not known or not authorization.drives(self.known.lease):
            refused = protocol.StepBegun(
                step=ask.step, action_id=ask.action_id, reason="not_driver" if known else "unknown"
            )
            self.sender.post("wizard/begun", refused)
            return
        now = time.time()
        press = progress.judge(ask.step, now)
        assert press is not None
        reason = self._begin(authorization, press, ask)
        if not reason:  # what the robot does not do is not done, and may be pressed again
            progress.press(ask.step, now)
        begun = protocol.StepBegun(
            step=ask.step,
            action_id=ask.action_id,
            deviation=press.deviation,
            skipped=press.skipped,
            reason=reason,
        )
        self.sender.post("wizard/begun", begun)
        told = {"step": ask.step, "id": ask.action_id, "deviation": press.deviation}
        self._launch(
            self._note(self._session(), leases.STEP, **told, skipped=press.skipped, reason=reason)
        )

    def _begin(
        self, authorization: WizardAuthorization, press: Press, ask: protocol.BeginStep
    ) -> str:
        """Send what a step asks of the robot; return why that could not be, or nothing."""
        step = press.step
        if step.is_driven_by_page:
            seconds = step.drive.seconds + 1.0 if step.drive is not None else TURN_SECONDS
            authorization.script_until = time.monotonic() + seconds
            return ""
        assert self.progress is not None
        language = self.progress.script.language
        action = action_of(step, language, action_id=ask.action_id, stamp=ask.stamp)
        assert action is not None  # as of every step that the page does not drive
        return self._send_action(authorization, action)

    def _send_action(self, authorization: WizardAuthorization, action: Action) -> str:
        try:
            stamped = authorization.stamp_action(action, self.known.lease)
        except FrameRefused as refused:
            return str(refused)
        return "" if self._send_to_robot("command/action", stamped) else "robot_unreachable"

    def _line(self, authorization: WizardAuthorization, ask: protocol.FreeLine) -> None:
        """Say what is not in the script, which is a deviation."""
        language = self.progress.script.language if self.progress is not None else ""
        action = Say(
            action_id=ask.action_id,
            stamp=ask.stamp,
            text=ask.text,
            language=language,
            aloud=ask.aloud,
        )
        reason = self._send_action(authorization, action)
        self.sender.post(
            "wizard/begun", protocol.StepBegun(step="free", action_id=ask.action_id, reason=reason)
        )
        if not reason:
            self._launch(
                self._note(
                    self._session(), leases.LINE, id=ask.action_id, text=ask.text, aloud=ask.aloud
                )
            )

    def _session(self) -> str | None:
        return self.authorization.session if self.authorization is not None else None

    async def _note(self, session: str | None, kind: str, **data: Any) -> None:
        if session is None:
            return
        try:
            await query(leases.note, session, kind, self.user, timezone.now(), **data)
        except (DatabaseError, InterfaceError) as error:
            log.error("wizard_not_recorded", session=session, event_type=kind, reason=str(error))

    # --- what the page is told --------------------------------------------------------------------

    def handle_message(self, inbound: ReceivedMessage) -> None:
        """Take a message of the robot, or a notice of the participant's session."""
        authorization = self.authorization
        assert authorization is not None
        if inbound.suffix == NOTICE:
            self._handle_notice(str(inbound.frame))
        elif inbound.suffix == "lease":
            self._lease_changed(authorization, inbound.message)
        elif (
            not self._tells_connection(inbound)
            and (out := wizard_relay.for_wizard(inbound, authorization.peer)) is not None
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

    def _lease_changed(self, authorization: WizardAuthorization, lease: Lease | None) -> None:
        self.changed.set()
        session = authorization.session
        if session is None or authorization.drives(lease):
            return
        is_same = lease is not None and lease.session == session
        if is_same and lease is not None and lease.wizard_epoch < authorization.epoch:
            return  # an older copy
        authorization.let_go()
        self.sender.post("wizard/lost", protocol.Lost(reason="taken" if is_same else "ended"))

    # --- what time brings -------------------------------------------------------------------------

    async def _look_in_turn(self) -> None:
        async with self.turn:
            await self._look()

    async def _is_welcome(self) -> bool:
        key = self.scope["session"].session_key
        return await query(_is_welcome, key, self.user, self.name)

    async def _look_again(self) -> None:
        """End the page if the rights of its user have changed and it may not stay."""
        if not await self._is_welcome():
            self.sender.end(pages.NOT_ALLOWED)

    async def _look(self) -> None:
        authorization = self.authorization
        assert authorization is not None
        scene = await query(_scene, self.user, self.robot, authorization.peer)
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
        """Know how far the script is, also after the page was loaded anew."""
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
    """Return the session at a robot, for an operator's page with this peer id; None without one
    that is this operator's.
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
