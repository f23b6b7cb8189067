"""Which roles may send which actions.

Everything needs the live lease, except what the first table gives to a role. Stop and e-stop are
open to everyone and are not checked here.
"""

from dataclasses import dataclass

from robots.agent.safety.clock_sync import SERVER_PEER, PeerClocks
from robots.api.messages import (
    UNCONDITIONAL,
    Action,
    AnswerCall,
    Call,
    Cancel,
    Capability,
    ClearEStop,
    ConfirmWords,
    Dock,
    Follow,
    Goto,
    Knock,
    Lease,
    Photo,
    PointCommand,
    Relocalize,
    ResendStates,
    Role,
    SafetyTest,
    Say,
    Tilt,
    Undock,
    Way,
)

ACTION_AGE = 3.0

STAFF = frozenset({"staff", "owner", "server"})
WITHOUT_LEASE: dict[type[Action], frozenset[str]] = {
    Photo: STAFF,
    Relocalize: STAFF,
    Cancel: STAFF,
    Dock: frozenset({"server"}),
    Tilt: frozenset({"server"}),  # levelled between two sessions
    ResendStates: STAFF,
    ClearEStop: frozenset({"staff", "owner", "screen"}),
    Say: frozenset({"screen"}),
    ConfirmWords: frozenset({"screen"}),
    AnswerCall: frozenset({"screen"}),
    SafetyTest: frozenset({"staff", "owner"}),
}
NEVER_THE_DRIVER: tuple[type[Action], ...] = (
    ResendStates,
    ClearEStop,
    AnswerCall,
    ConfirmWords,
    SafetyTest,
)
# For a visitor whose robot a hidden operator drives: nothing that moves it.
OF_A_VISITOR: tuple[type[Action], ...] = (Photo, Say, Call, Knock)
MOTION: tuple[type[Action], ...] = (Goto, Follow, Dock, Undock)
MOVING: tuple[type[Action], ...] = (*MOTION, Tilt)
# Allowed by every lease, like stop and e-stop.
NEVER_LIMITED: tuple[type[Action], ...] = (Cancel,)
NEEDS: dict[type[Action], Capability] = {
    Goto: "goto",
    Follow: "follow",
    Dock: "dock",
    Undock: "undock",
    Tilt: "tilt",
    Photo: "photo",
    Relocalize: "relocalize",
    Say: "say",
    ConfirmWords: "say",
    Call: "call",
    AnswerCall: "call",
}


@dataclass(frozen=True)
class CommandSender:
    """The origin of a message: `peer` is the data channel's, from signalling, and `role` that of
    its offer, stamped by the server. On MQTT the server has stamped role, session and epoch in the
    message.
    """

    transport: Way
    peer: str | None = None
    retained: bool = False
    role: Role = "observer"


def role_of(action: Action | PointCommand, sender: CommandSender, lease: Lease | None) -> str:
    """Return the role that counts. On a data channel not the page's own claim counts, but its peer
    and whether it is the robot's screen.
    """
    if sender.transport == "mqtt":
        return action.role
    if lease is not None and sender.peer == lease.driver:
        return "driver"
    if lease is not None and sender.peer == lease.peer and isinstance(action, Action):
        return "observer" if isinstance(action, UNCONDITIONAL) else "visitor"
    return "screen" if sender.role == "screen" else "observer"


def mismatch(
    session: str | None, epoch: int, sender: CommandSender, lease: Lease | None
) -> str | None:
    """Return why a driver's message does not belong to the live lease, or None."""
    if lease is None:
        return "no_lease"
    if lease.driver is None or (sender.transport == "datachannel" and sender.peer != lease.driver):
        return "observer"
    if session != lease.session:
        return "wrong_session"
    return "wrong_epoch" if epoch != lease.driver_epoch else None


def forbidden(
    lease: Lease, sender: CommandSender, *, method: str | None = None, action: Action | None = None
) -> bool:
    """Tell whether the terms of a lease exclude a transport, input method or type of action."""
    if lease.ways is not None and sender.transport not in lease.ways:
        return True
    if method is not None:
        return lease.methods is not None and method not in lease.methods
    return (
        lease.actions is not None
        and action is not None
        and action.__struct_config__.tag not in lease.actions
    )


def refusal(
    action: Action, sender: CommandSender, lease: Lease | None, capabilities: frozenset[Capability]
) -> str | None:
    """Return in one word why this sender may not have this action, or None."""
    role = role_of(action, sender, lease)
    kind = type(action)
    if role == "observer" or (role == "screen" and role not in WITHOUT_LEASE.get(kind, ())):
        return "observer"
    if isinstance(action, ClearEStop) and (sender.transport != "mqtt" or not action.user):
        return "not_from_server"
    if role == "driver":
        reason = _drivers_refusal(action, sender, lease)
    elif role == "visitor":
        reason = _visitors_refusal(action, lease)
    else:
        reason = None if role in WITHOUT_LEASE.get(kind, ()) else "role"
    return reason or ("unsupported" if kind in NEEDS and NEEDS[kind] not in capabilities else None)


def _drivers_refusal(action: Action, sender: CommandSender, lease: Lease | None) -> str | None:
    kind = type(action)
    if kind in NEVER_THE_DRIVER:
        return "role"
    reason = mismatch(action.session, action.epoch, sender, lease)
    if reason or lease is None:
        return reason
    is_limited = kind not in NEVER_LIMITED and forbidden(lease, sender, action=action)
    return "not_allowed" if is_limited else None


def _visitors_refusal(action: Action, lease: Lease | None) -> str | None:
    """Return why the visitor whose robot a wizard drives may not have this action, or None."""
    if lease is None:
        return "no_lease"
    if lease.kind == "visitor" or not isinstance(action, OF_A_VISITOR):
        return "role"
    if action.session != lease.session:
        return "wrong_session"
    return "wrong_epoch" if action.epoch != lease.epoch else None


def staleness(
    action: Action,
    sender: CommandSender,
    lease: Lease | None,
    clocks: PeerClocks,
    *,
    now: float,
    unix: float,
) -> str | None:
    """Return why an action is too old or from the future, or None.

    The stamp of a driver or visitor is judged by their own clock; all others by the server's, or by
    ours before the server's is known.
    """
    if sender.retained:
        return "retained"
    role = role_of(action, sender, lease)
    if role in {"driver", "visitor"}:
        peer = None if lease is None else lease.driver if role == "driver" else lease.peer
        clock = clocks.of(peer) if peer is not None else None
        if clock is None:
            return "clock_unknown"
        age = clock.age(action.stamp, now)
    else:
        rough = clocks.rough_age(SERVER_PEER, action.stamp, now)
        age = unix - action.stamp if rough is None else rough
    if age > ACTION_AGE:
        return "stale"
    return "future" if age < -ACTION_AGE else None
