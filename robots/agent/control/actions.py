"""Actions, which are all requests to a robot besides velocities: the kernel permits each, it starts
once, and is reported until it ends.
"""

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Coroutine
from typing import Any

import msgspec
import structlog

from robots.agent.control.calls import CallControl
from robots.agent.control.owned_actions import OwnedActions
from robots.agent.control.publisher import Media, Publisher
from robots.agent.control.receipts import Receipts
from robots.agent.control.reports import Reports
from robots.agent.control.safety_test import SafetyTestRun
from robots.agent.control.supervised_adapter import AdapterLink, adapter_errors
from robots.agent.media.photos import encode_jpeg
from robots.agent.robot_interface import ActionProgress, ActionRefusedError, AdapterError
from robots.agent.safety.kernel import Kernel
from robots.agent.safety.permissions import MOTION, MOVING, CommandSender, role_of
from robots.agent.timing import Cadence, TimeSource
from robots.api.messages import (
    ENDED,
    Action,
    ActionState,
    ActionStatus,
    AnswerCall,
    Call,
    Cancel,
    ClearEStop,
    ConfirmWords,
    Dock,
    EStop,
    Knock,
    Lease,
    Mode,
    Photo,
    Receipt,
    ResendStates,
    SafetyTest,
    Say,
    Stop,
    Undock,
    Words,
)
from robots.api.reasons import ReasonCode

ACTIONS_KEPT = 1000  # whose last status is known


class ActionHistory:
    """The last status of the newest actions, by id."""

    def __init__(self) -> None:
        self._statuses: OrderedDict[str, ActionStatus] = OrderedDict()

    def of(self, action_id: str) -> ActionStatus | None:
        return self._statuses.get(action_id)

    def record(self, status: ActionStatus) -> bool:
        """Store a status; return False when the action had already ended."""
        last = self._statuses.get(status.action_id)
        if last is not None and last.status in ENDED:
            return False
        self._statuses[status.action_id] = status
        while len(self._statuses) > ACTIONS_KEPT:
            self._statuses.popitem(last=False)
        return True

    def runs(self, action_id: str) -> bool:
        last = self._statuses.get(action_id)
        return last is not None and last.status not in ENDED


log = structlog.stdlib.get_logger(__name__)

REFUSALS_ANSWERED = 0.05  # s between two answers to refused actions, so that no flood is answered
PHOTOS_AT_ONCE = 4
RESENT_AT_ONCE = 100
RESEND_PAUSE = 0.05
START_TIMEOUT = 10.0  # s for which an action may wait for the end of an earlier one

Spawn = Callable[[Coroutine[Any, Any, None]], None]
Result = dict[str, float | str | bool | None]


class Actions:
    """One handler for each kind of action.

    `latch_changed` returns when the latch is on the disk. `send_velocity` sends the kernel's
    decision to the base at once. `spawn` runs a coroutine in the background.
    """

    def __init__(
        self,
        kernel: Kernel,
        adapter: AdapterLink,
        reports: Reports,
        out: Publisher,
        *,
        latch_changed: Callable[[], Coroutine[Any, Any, None]],
        send_velocity: Callable[[], None],
        spawn: Spawn,
        times: TimeSource,
        calls: CallControl,
        media: Media,
    ) -> None:
        self._kernel, self._adapter, self._reports, self._out = kernel, adapter, reports, out
        self._latch_changed, self._send_velocity = latch_changed, send_velocity
        self._spawn, self._times = spawn, times
        self._calls, self._media = calls, media
        self._history = ActionHistory()
        self._receipts = Receipts()
        self._refusals = Cadence(REFUSALS_ANSWERED)
        self._photos = 0
        self._waiting: Action | None = None  # until the robot is at rest
        # statuses that become true when the robot is at rest and the RCA has confirmed the end
        self._final: dict[str, ActionStatus] = {}
        self._waits_for_release = False  # a stop was reported, its release was not
        self.safety_test: SafetyTestRun | None = None
        self._cleared_by = ""  # the role that cleared it, if not its driver
        self._owned = OwnedActions(adapter, spawn, self._ends_changed)

    def tick(self) -> None:
        """Start the action that waited for the robot to be at rest, and report those that have
        ended.
        """
        self._begin_waiting()
        self._report_release()
        kernel = self._kernel
        if not self._final or kernel.is_end_unconfirmed:
            return
        if kernel.is_at_rest or kernel.braking(self._times.now()) is None:
            final, self._final = self._final, {}
            for status in final.values():
                self._end(status)

    def _report_release(self) -> None:
        """Report that the robot may move again after a stop that held it."""
        if self._waits_for_release and self._kernel.is_released:
            self._waits_for_release = False
            self._reports.event("released", detail=self._cleared_by or "driver")

    def _note_hold(self) -> None:
        """Note a stop whose release is to be reported."""
        self._waits_for_release, self._cleared_by = not self._kernel.is_released, ""

    def _begin_waiting(self) -> None:
        """Start the waiting navigation once the kernel allows it: the robot is at rest, and the
        end of an earlier action is confirmed. It is dropped if it was cancelled in between, and
        fails if that end is not confirmed within `START_TIMEOUT` seconds.
        """
        waiting, running = self._waiting, self._kernel.navigation
        if waiting is None:
            return
        if running is None or running.action_id != waiting.action_id:
            self._waiting = None
        elif running.may_begin:
            self._waiting = None
            self._owned.begin(waiting.action_id)
            self._spawn(self._start(waiting))
        elif self._kernel.is_end_unconfirmed and self._times.now() - running.since > START_TIMEOUT:
            self._waiting = None
            self._kernel.navigation_ended(waiting.action_id)
            self._answer(waiting, "FAILED", "navigation_does_not_end")

    def cancel_all(self) -> None:
        """Cancel every action that moves the robot or its head: it was stopped, or the RCA was
        lost.
        """
        self._owned.cancel_all()

    def _ends_changed(self, reason: str) -> None:
        self._kernel.is_end_unconfirmed = self._owned.is_end_unconfirmed
        if not self._kernel.is_end_unconfirmed:
            self._reports.errors.pop(ReasonCode.CANCEL, None)
        elif reason:
            is_new = ReasonCode.CANCEL not in self._reports.errors
            self._reports.errors[ReasonCode.CANCEL] = ReasonCode.CANCEL.of(reason)[:300]
            if is_new:
                self._reports.send_soon()

    def take(self, action: Action, sender: CommandSender) -> None:
        """Perform an action or report why it is refused."""
        action = self._stamped(action, sender)
        if isinstance(action, Stop):
            self._stop(action, sender)
        elif isinstance(action, EStop):
            self._estop(action, sender)
        elif (before := self._history.of(action.action_id)) is not None:
            self._out.send("action", before)
            self._send_receipt(action.action_id)
        elif reason := self._kernel.permit(
            action, sender, now=self._times.now(), unix=self._times.unix()
        ):
            log.info(
                "action_refused",
                type=kind_of(action),
                reason=str(reason),
                transport=sender.transport,
            )
            if self._refusals.due(self._times.now()):
                self._out.send("action", self._status(action, "FAILED", reason))
        else:
            self._begin(action)

    def progressed(self, progress: ActionProgress) -> None:
        """Take the adapter's news of an action."""
        if progress.status in ENDED:
            self._owned.ended(progress.action_id)
        before = self._history.of(progress.action_id)
        if before is None or progress.action_id in self._final:
            return
        status = msgspec.structs.replace(
            before,
            status=progress.status,
            stamp=self._times.unix(),
            reason=progress.reason[:300],
            result=progress.result,
        )
        if progress.status in ENDED and self._kernel.navigation_ended(progress.action_id):
            self._final[progress.action_id] = status
        else:
            self._end(status)

    def cancelled(self, action_id: str, reason: str) -> None:
        """Cancel at the adapter what the kernel has ended, and report it when the robot is at rest.
        An action that has not started ends at once.
        """
        status = self._ended_by(action_id, reason)
        if self._waiting is not None and self._waiting.action_id == action_id:
            self._waiting = None
            self._end(status)
        else:
            self._final[action_id] = status
            self._owned.cancel(action_id)

    def _ended_by(self, action_id: str, reason: str) -> ActionStatus:
        before = self._history.of(action_id)
        return ActionStatus(
            action_id=action_id,
            status="CANCELLED",
            stamp=self._times.unix(),
            type=before.type if before else "",
            reason=reason,
        )

    def _end(self, status: ActionStatus) -> None:
        """Report a status, and the event of its goal."""
        status = msgspec.structs.replace(status, stamp=self._times.unix())
        event = {"FINISHED": "goal_reached", "FAILED": "goal_blocked"}.get(status.status)
        if self._send(status) and event and status.type in {"goto", "follow"}:
            self._reports.event(event, action_id=status.action_id, detail=status.reason)

    def button_pressed(self) -> None:
        self.cancel_all()
        self._latched("button", None)

    def _stamped(self, action: Action, sender: CommandSender) -> Action:
        """Return the action with the role and user that count. A page's own claims on a data
        channel are discarded.
        """
        if sender.transport == "mqtt":
            return action
        lease = self._kernel.leases.live(self._times.now())
        role = role_of(action, sender, lease)
        is_known = lease is not None and role in {"driver", "visitor"}
        user = lease.who if lease is not None and is_known else ""
        return msgspec.structs.replace(action, role=role if is_known else "observer", user=user)

    # --- stop -------------------------------------------------------------------------------------

    def _stop(self, action: Stop, sender: CommandSender) -> None:
        obeyed = self._kernel.stop(action, sender, self._times.now())
        self._send_velocity()
        if obeyed:  # a late copy does not end what its driver has begun since
            self.cancel_all()
        self._stopped(action, obeyed=obeyed)

    def _estop(self, action: EStop, sender: CommandSender) -> None:
        watches = role_of(action, sender, self._kernel.leases.live(self._times.now())) == "observer"
        obeyed = self._kernel.estop(action, sender, now=self._times.now(), unix=self._times.unix())
        self._send_velocity()
        self.cancel_all()
        if watches:
            self._stopped(action, obeyed=obeyed)
        elif obeyed:
            self._latched(action.detail, action)
        else:
            self._reports.send_soon()

    def _stopped(self, action: Stop | EStop, *, obeyed: bool) -> None:
        if obeyed:
            self._reports.event("stopped", action_id=action.action_id, detail=action.role)
            self._note_hold()
        self._reports.send_soon()
        self._out.send("action", self._status(action, "FINISHED"))

    def _latched(self, detail: str, action: EStop | None) -> None:
        self._note_hold()
        latch = self._kernel.latch
        source = latch.label if latch else ""
        log.warning("estop", source=source, detail=detail)
        self._reports.event(
            "estop",
            action_id=action.action_id if action else None,
            detail=f"{source} {detail}".strip(),
        )
        self._reports.send_soon()
        self._spawn(self._keep_latch(action))

    async def _keep_latch(self, action: Action | None) -> None:
        await self._latch_changed()
        if action is not None:
            self._out.send("action", self._status(action, "FINISHED"))

    # --- everything else --------------------------------------------------------------------------

    def _begin(self, action: Action) -> None:
        match action:
            case ClearEStop():
                self._clear_estop(action)
            case Cancel():
                self._cancel(action)
            case Photo():
                self._photo(action)
            case ResendStates():
                self._resend(action)
            case Say():
                self._send_words(action)
            case ConfirmWords():
                self._confirm_words(action)
            case Call() | AnswerCall():
                self._call(action)
            case Knock():
                self._knock(action)
            case SafetyTest():
                self._begin_safety_test(action)
            case _:
                self._hand_over(action)

    def _clear_estop(self, action: ClearEStop) -> None:
        was = self._kernel.latch
        self._kernel.clear_estop(self._times.now())
        self._cleared_by = action.role if self._kernel.is_released else ""
        self._history.record(self._status(action, "RUNNING"))
        if was is not None:
            by = f"{action.role}:{action.user}"
            log.warning("estop_cleared", by=by, was=was.label)
            self._reports.event("estop_cleared", action_id=action.action_id, detail=by)
        self._reports.send_soon()
        self._spawn(self._cleared(action))

    async def _cleared(self, action: ClearEStop) -> None:
        await self._latch_changed()
        self._answer(action, "FINISHED")

    def _cancel(self, action: Cancel) -> None:
        if self._kernel.cancel(action.target) is not None:
            for action_id, reason in self._kernel.drain_cancelled():
                self.cancelled(action_id, reason)
            self._cancel_later(action)
        elif action.target in self._final:
            self._cancel_later(action)
        elif action.target is not None and self._history.runs(action.target):
            self._send(self._ended_by(action.target, "cancelled"))
            self._owned.cancel(action.target)
            self._answer(action, "FINISHED")
        else:
            self._answer(action, "FAILED", "nothing_runs")

    def _cancel_later(self, action: Cancel) -> None:
        """Report a cancel as done together with the action that it ends."""
        self._answer(action, "RUNNING")
        if self._final:
            self._final[action.action_id] = self._status(action, "FINISHED")
        else:
            self._answer(action, "FINISHED")

    def _hand_over(self, action: Action) -> None:
        """Give an action to the adapter: motion after the robot is at rest (`_begin_waiting`),
        anything else at once.
        """
        self._answer(action, "WAITING")
        if isinstance(action, MOTION):
            self._kernel.navigate(
                action.action_id,
                _mode_of(action),
                ordered_by_server=action.role == "server",
                now=self._times.now(),
            )
            for action_id, reason in self._kernel.drain_cancelled():
                self.cancelled(action_id, reason)
            self._waiting = action
        else:
            if isinstance(action, MOVING):
                self._owned.begin(action.action_id)
            self._spawn(self._start(action))

    async def _start(self, action: Action) -> None:
        """Start an action at the adapter.

        A cancel can arrive while the adapter starts it: the adapter checks `is_wanted` just before
        it sends the order, and confirmations of the end do not count until the start has returned.
        A refused action certainly does not run; after any other error it may, so it is cancelled
        until its end is confirmed.
        """
        action_id = action.action_id
        is_owned = isinstance(action, MOVING)
        try:
            with self._owned.starting(action_id):
                await self._adapter.start(
                    action, lambda: not is_owned or self._owned.is_wanted(action_id)
                )
        except ActionRefusedError as error:
            self._owned.ended(action_id)
            if action_id not in self._final:
                self._not_started(action, str(error))
        except AdapterError as error:
            if is_owned:  # it may run despite the error
                self._owned.cancel(action_id)
            self._not_started(action, ReasonCode.NOT_CONNECTED.of(error))

    def _not_started(self, action: Action, reason: str) -> None:
        self._kernel.navigation_ended(action.action_id)
        self._answer(action, "FAILED", reason)

    def _begin_safety_test(self, action: SafetyTest) -> None:
        """Start a test of the safety functions, or report why the robot cannot have one now."""
        kernel, now = self._kernel, self._times.now()
        lease = kernel.leases.live(now)
        docked = self._reports.docked or bool(self._reports.reading.charger_contact)
        if lease is None or lease.peer != action.action_id or self.safety_test is not None:
            self._answer(action, "FAILED", "no_lease")
        elif docked and "undock" not in kernel.capabilities:
            self._answer(action, "FAILED", ReasonCode.DOCKED)
        elif reason := kernel.fault or (kernel.latch and "estop"):
            self._answer(action, "FAILED", reason)
        elif kernel.is_held_by_person:
            self._answer(action, "FAILED", ReasonCode.STOPPED)
        elif kernel.navigation is not None or kernel.is_end_unconfirmed:
            self._answer(action, "FAILED", "navigating")
        else:
            log.warning("safety_test", by=action.role)
            self._answer(action, "RUNNING")
            self.safety_test = SafetyTestRun(
                action, kernel, lease, now, status_of=self._history.of, docked=docked
            )

    def end_safety_test(self) -> None:
        """Report the end of the test, if it has ended; a cancelled one has been reported."""
        run = self.safety_test
        if run is not None and run.state != "RUNNING":
            self.safety_test = None
            self._answer(run.action, run.state, run.reason, run.result)

    def runs(self, action_id: str) -> bool:
        return self._history.runs(action_id)

    def _photo(self, action: Photo) -> None:
        if self._photos >= PHOTOS_AT_ONCE:
            self._answer(action, "FAILED", "busy")
            return
        self._photos += 1
        self._answer(action, "RUNNING")
        self._spawn(self._take_photo(action))

    async def _take_photo(self, action: Photo) -> None:
        try:
            with adapter_errors():  # the camera may be the adapter's own
                frame = await asyncio.to_thread(self._media.snapshot)
                photo = await asyncio.to_thread(encode_jpeg, frame) if frame is not None else None
        except AdapterError as error:
            log.warning("photo_failed", reason=str(error))
            frame = photo = None
        finally:
            self._photos -= 1
        if photo is None:
            self._answer(action, "FAILED", "no_picture" if frame is None else "too_large")
            return
        self._out.record(f"photo/{action.action_id}", photo.jpeg)
        self._reports.event("photo", action_id=action.action_id, sha256=photo.sha256)
        size = float(len(photo.jpeg))
        result: Result = {"sha256": photo.sha256, "bytes": size, "stamp": photo.stamp}
        self._answer(action, "FINISHED", result=result)

    def _resend(self, action: ResendStates) -> None:
        if action.boot != self._reports.boot:
            self._answer(action, "FAILED", "unknown_boot")
        elif action.last < action.first:
            self._answer(action, "FAILED", "empty_range")
        else:
            self._answer(action, "RUNNING")
            self._spawn(self._resend_states(action))

    async def _resend_states(self, action: ResendStates) -> None:
        """Send stored states, a hundred at a time, so that ten minutes of them do not delay new
        ones.
        """
        states = self._reports.kept(action.first, action.last)
        for start in range(0, len(states), RESENT_AT_ONCE):
            for payload in states[start : start + RESENT_AT_ONCE]:
                self._out.record("state", payload)
            await asyncio.sleep(RESEND_PAUSE)
        missing = action.last - action.first + 1 - len(states)
        result: Result = {"sent": float(len(states)), "missing": float(missing)}
        self._answer(action, "FINISHED", result=result)

    def _send_words(self, action: Say) -> None:
        """Send words to the other side. Words from the robot's screen need a visitor who receives
        them.
        """
        lease = self._kernel.leases.live(self._times.now())
        if lease is None:
            self._answer(action, "FAILED", "nobody_there")
            return
        here = action.role == "screen"
        words = Words(
            stamp=self._times.unix(),
            action_id=action.action_id,
            session=lease.session,
            by="screen" if here else "driver",
            who=action.user if here else _voice_of(action, lease),
            text=action.text,
            language=action.language,
            aloud=action.aloud and not here,
            receipts=not here,
        )
        if not here:
            self._receipts.sent(action.action_id, lease.session)
        self._out.send("words", words)
        self._answer(action, "FINISHED")

    def _confirm_words(self, action: ConfirmWords) -> None:
        lease = self._kernel.leases.live(self._times.now())
        session = lease.session if lease else None
        reason, is_news = self._receipts.confirm(action.target, action.state, session)
        if is_news:
            self._send_receipt(action.target)
        self._answer_with(action, reason)

    def _send_receipt(self, action_id: str) -> None:
        """Report to the driver how far their words came, if a display has confirmed them."""
        if found := self._receipts.of(action_id):
            session, state = found
            stamp = self._times.unix()
            receipt = Receipt(stamp=stamp, action_id=action_id, session=session, state=state)
            self._out.send("receipt", receipt)

    def _call(self, action: Call | AnswerCall) -> None:
        now = self._times.now()
        lease = self._kernel.leases.live(now)
        reason = None
        if isinstance(action, AnswerCall) and action.knock is not None:
            reason = self._calls.answer_knock(
                action.knock, accept=action.accept, lease=lease, now=now
            )
        elif isinstance(action, AnswerCall):
            reason = self._calls.answer(accept=action.accept, lease=lease, now=now)
        elif lease is not None:
            self._calls.ask(action, lease, now)
        self._reports.send_soon()
        self._answer_with(action, reason)

    def _knock(self, action: Knock) -> None:
        now = self._times.now()
        lease, audible = self._kernel.leases.live(now), self._media.audible
        reason = self._calls.knock(action.action_id, lease, now, audible=audible)
        if reason is None:
            self._media.ring()
        self._reports.send_soon()
        self._answer_with(action, reason)

    def _status(
        self, action: Action, status: ActionState, reason: str = "", result: Result | None = None
    ) -> ActionStatus:
        return ActionStatus(
            action_id=action.action_id,
            status=status,
            stamp=self._times.unix(),
            type=kind_of(action),
            reason=reason[:300],
            result=result or {},
        )

    def _answer(
        self, action: Action, status: ActionState, reason: str = "", result: Result | None = None
    ) -> None:
        self._send(self._status(action, status, reason, result))

    def _answer_with(self, action: Action, reason: str | None) -> None:
        """Report an action as failed for a reason, or as finished without one."""
        self._answer(action, "FAILED" if reason else "FINISHED", reason or "")

    def _send(self, status: ActionStatus) -> bool:
        """Publish a status and return True, unless the action had already ended."""
        if not self._history.record(status):
            return False
        self._out.send("action", status)
        return True


def kind_of(action: Action) -> str:
    """Return an action's type on the wire."""
    return str(type(action).__struct_config__.tag)


def _mode_of(action: Action) -> Mode:
    return "docking" if isinstance(action, Dock | Undock) else "goto"


def _voice_of(action: Say, lease: Lease) -> str:
    """Return who speaks: the visitor, or "" (the robot itself) for a hidden operator."""
    return "" if lease.kind == "wizard" and action.role == "driver" else lease.who
