"""Who may ask a robot for what: one table, and one question.

Everything needs the live lease, but for what this table gives to a role. Stop and e-stop never come
here: they are for anybody.
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
    Tilt: frozenset({"server"}),  # levelled between two visits
    ResendStates: STAFF,
    ClearEStop: frozenset({"staff", "owner", "screen"}),
    Say: frozenset({"screen"}),
    ConfirmWords: frozenset({"screen"}),
    AnswerCall: frozenset({"screen"}),
}
NEVER_THE_DRIVER: tuple[type[Action], ...] = (
    ResendStates,
    ClearEStop,
    AnswerCall,
    ConfirmWords,
)
# What a visitor asks for whose robot a hidden operator drives: nothing that moves it.
OF_A_VISITOR: tuple[type[Action], ...] = (Photo, Say, Call, Knock)
MOTION: tuple[type[Action], ...] = (Goto, Follow, Dock, Undock)
MOVING: tuple[type[Action], ...] = (*MOTION, Tilt)
# What a lease that limits actions never keeps a driver from, beside stop and e-stop.
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
    """How a message came: `peer` is the data channel's, given by signalling, and `role` that of its
    offer, which the server has stamped.

    On MQTT the server has stamped role, session and epoch in the message itself.
    """

    way: Way
    peer: str | None = None
    retained: bool = False
    role: Role = "observer"


def role_of(action: Action | PointCommand, sender: CommandSender, lease: Lease | None) -> str:
    """Return the role that counts: on a data channel the page's own word is worth nothing, its peer
    is, and that it is the robot's screen.
    """
    if sender.way == "mqtt":
        return action.role
    if lease is not None and sender.peer == lease.driver:
        return "driver"
    if lease is not None and sender.peer == lease.peer and isinstance(action, Action):
        return "observer" if isinstance(action, UNCONDITIONAL) else "visitor"
    return "screen" if sender.role == "screen" else "observer"


def mismatch(
    session: str | None, epoch: int, sender: CommandSender, lease: Lease | None
) -> str | None:
    """Return why a driver's message does not belong to the live lease, or None when it does."""
    if lease is None:
        return "no_lease"
    if lease.driver is None or (sender.way == "datachannel" and sender.peer != lease.driver):
        return "observer"
    if session != lease.session:
        return "wrong_session"
    return "wrong_epoch" if epoch != lease.driver_epoch else None


def forbidden(
    lease: Lease, sender: CommandSender, *, method: str | None = None, action: Action | None = None
) -> bool:
    """Tell whether the terms of a lease keep its driver from a way of control, an input method, or
    a type of action.
    """
    if lease.ways is not None and sender.way not in lease.ways:
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
    """Return in one word why this sender may not have this action, or None when it may."""
    role = role_of(action, sender, lease)
    kind = type(action)
    if role == "observer" or (role == "screen" and role not in WITHOUT_LEASE.get(kind, ())):
        return "observer"
    if isinstance(action, ClearEStop) and (sender.way != "mqtt" or not action.user):
        return "not_from_server"
    if role == "driver":
        reason = (
            "role"
            if kind in NEVER_THE_DRIVER
            else mismatch(action.session, action.epoch, sender, lease)
        )
        if (
            reason is None
            and lease is not None
            and kind not in NEVER_LIMITED
            and forbidden(lease, sender, action=action)
        ):
            reason = "not_allowed"
    elif role == "visitor":
        reason = _visitors_refusal(action, lease)
    else:
        reason = None if role in WITHOUT_LEASE.get(kind, ()) else "role"
    return reason or ("unsupported" if kind in NEEDS and NEEDS[kind] not in capabilities else None)


def _visitors_refusal(action: Action, lease: Lease | None) -> str | None:
    """Return why whoever has the session, and does not drive, may not have this action."""
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
    """Return why an action is not of this moment, or None.

    The stamp of a driver or visitor is judged by their own clock; everybody else's by the server's,
    or ours before the server was heard.
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
