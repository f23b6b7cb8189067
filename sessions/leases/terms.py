"""The terms of a session: what an app above this one fixes when the robot is first granted, stored
with the session for good.

This app knows no studies. One that does registers a provider (in its AppConfig.ready). It is asked,
in any process, before a visitor may have a robot, and once when a session gets the robot for the
first time. Its answer is stored in `Session.terms`, sent to the robot with every lease, which
enforces it for every transport of commands, and sent to the page.
"""

import datetime
from typing import TYPE_CHECKING, Any, Literal

import msgspec
import structlog

from robots.api.floorplan import DoorState
from robots.api.messages import AssistLevel, NetworkLab
from robots.api.prepared import prepare

log = structlog.stdlib.get_logger(__name__)

if TYPE_CHECKING:
    from accounts.models import User
    from robots.models import Robot
    from sessions.models import Session


class Terms(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Fixed values; None or empty leaves it to the robot and the visitor. Metres, radians, seconds.

    `driver` is who drives: the visitor, or a hidden operator (sessions/wizard/). `actions` are
    types of Robot API actions, `controllers` input methods, of the visitor. A visitor who drives
    and then leaves has completed the session only where `leaving_completes`. A turn ends after
    `turn_seconds` if another visitor waits, and with `turn_always` in any case. A `private` session
    is shown to its visitor, to operators of the robot, and to users whom a provider allows it
    (`may_watch`). `study` is the provider's own data and has no meaning here.
    """

    label: str = ""
    driver: Literal["visitor", "wizard"] = "visitor"
    linear: float | None = None
    angular: float | None = None
    assist: AssistLevel | None = None
    actions: tuple[str, ...] | None = None
    controllers: tuple[str, ...] | None = None
    control_way: Literal["any", "datachannel", "mqtt"] = "any"
    interface: str = ""
    turn_seconds: float | None = None
    turn_always: bool = False
    grace_seconds: float | None = None
    idle_seconds: float | None = None
    doors: dict[str, DoorState] = {}
    control_network: NetworkLab | None = None
    video_network: NetworkLab | None = None
    leaving_completes: bool = True
    private: bool = False
    study: dict[str, Any] = {}


# Prefix of the reasons of sessions that wait for the robot to meet their terms.
START = "start"
NOT_DOCKED = "not_docked"  # the reason that a robot which docks by itself can remove

prepare(Terms)
FREE = Terms()


class UnreadableTerms(Terms, frozen=True, kw_only=True):
    """Replaces stored terms that this version cannot read: the robot obeys nothing, only the
    visitor sees the session, and the session manager ends it (sessions/leases/transitions.py).
    """

    actions: tuple[str, ...] | None = ()
    controllers: tuple[str, ...] | None = ()
    private: bool = True
    leaving_completes: bool = False


class NotGranted(Exception):
    """The session must not begin; the message is the reason, one of sessions.protocol.Refused."""


class Provider:
    """The questions to an app above this one, with the answers for a session without terms. All may
    use the ORM, and may be called again with the same result.
    """

    def why_not(self, user: "User", robot: "Robot", now: datetime.datetime) -> str:
        """Return why this visitor may not ask for the robot now, as a code; empty when allowed."""
        return ""

    def not_ready(self, user: "User", robot: "Robot", now: datetime.datetime) -> str:
        """Return why the robot does not yet meet the terms of this visitor's session, as a code;
        empty when it does, or there are none. The session waits, first in the queue, until it does.
        """
        return ""

    def granted(self, session: "Session", now: datetime.datetime) -> Terms | None:
        """Return the terms of a session that gets the robot for the first time; None when the
        provider has none for it.

        Raises:
            NotGranted: the session must not begin, and is ended.
        """
        return None

    def claims(self, user: "User", robot: "Robot") -> bool:
        """Tell whether a session that begins now would get terms of this provider."""
        return False

    def may_watch(self, user: "User", session: str) -> bool:
        """Tell whether a user may watch this private session of another."""
        return False

    def shown(self, session: str) -> dict[str, Any]:
        """Return the data of the newest `task` notice, for a page that reconnects."""
        return {}


_providers: list[Provider] = []


def register(provider: Provider) -> None:
    """Add a provider; registering twice has no effect."""
    if provider not in _providers:
        _providers.append(provider)


def why_not(user: "User", robot: "Robot", now: datetime.datetime) -> str:
    """Return the first reason of a provider against a session; empty when there is none."""
    return next(
        (reason for provider in _providers if (reason := provider.why_not(user, robot, now))), ""
    )


def not_ready(user: "User", robot: "Robot", now: datetime.datetime) -> str:
    """Return why a robot does not yet meet a session's terms, as in Scene.pause, or nothing."""
    return next(
        (
            f"{START}: {reason}"
            for provider in _providers
            if (reason := provider.not_ready(user, robot, now))
        ),
        "",
    )


def claims(user: "User", robot: "Robot") -> bool:
    """Tell whether a session that begins now would get terms."""
    return any(provider.claims(user, robot) for provider in _providers)


def may_watch(user: "User", session: str) -> bool:
    """Tell whether a provider lets this user watch a private session of another."""
    return any(provider.may_watch(user, session) for provider in _providers)


def of_granted(session: "Session", now: datetime.datetime) -> Terms:
    """Return the terms of a session that gets the robot for the first time.

    Raises:
        NotGranted: the session must not begin.
    """
    return next(
        (terms for provider in _providers if (terms := provider.granted(session, now)) is not None),
        FREE,
    )


def shown(session: str) -> dict[str, Any]:
    """Return the task's data for a page that takes a session; empty when there is none."""
    return next((data for provider in _providers if (data := provider.shown(session))), {})


def of(session: "Session") -> Terms:
    """Return the terms that a session was granted on."""
    if not session.terms:
        return FREE
    try:
        return msgspec.convert(session.terms, Terms)
    except msgspec.ValidationError as error:
        log.error("terms_unreadable", session=str(session.pk), reason=str(error))
        study = session.terms.get("study") if isinstance(session.terms, dict) else None
        return UnreadableTerms(study=study if isinstance(study, dict) else {})


def stored(terms: Terms) -> dict[str, Any]:
    """Return the value of `Session.terms`."""
    found: dict[str, Any] = msgspec.to_builtins(terms)
    return found
