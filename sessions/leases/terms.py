"""On what terms a session goes: what an app above this one fixes when the robot is first granted,
kept with the session for good.

This app knows no studies. One that does registers a provider (in its AppConfig.ready) and is asked,
in whichever process, before a visitor may have a robot, and once when a session gets it for the
first time. What it answers is stored in `Session.terms`, said to the robot with every lease, which
enforces it whichever way a command comes, and told to the page.
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
    """What is fixed; None or empty leaves a thing as the robot and the visitor have it. Metres,
    radians, seconds.

    `driver` is who drives: the visitor, or a hidden operator (sessions/wizard/). `actions` are
    types of Robot API actions, `controllers` input methods, of the visitor. One who drives and then
    leaves has completed the session only where `leaving_completes`. A turn ends after
    `turn_seconds` if somebody waits, and with `turn_always` even if nobody does. A `private` one is
    shown to its visitor, to who operates the robot, and to whom a provider says (`may_watch`).
    `study` is what the app above wants to find again; it means nothing here.
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


# how the reasons of sessions begin that wait for the robot to be as their terms want it
START = "start"
NOT_DOCKED = "not_docked"  # the one of them that a robot which goes home by itself can mend

prepare(Terms)
FREE = Terms()


class UnreadableTerms(Terms, frozen=True, kw_only=True):
    """Stands for stored terms that this version cannot read: the robot obeys nothing, only the
    visitor sees the session, and the session manager ends it (sessions/leases/transitions.py).
    """

    actions: tuple[str, ...] | None = ()
    controllers: tuple[str, ...] | None = ()
    private: bool = True
    leaving_completes: bool = False


class NotGranted(Exception):
    """The robot is not for this session after all; the message is the reason, one of
    sessions.protocol.Refused.
    """


class Provider:
    """What an app above this one answers; here, what most sessions get. All are called with the ORM
    at hand, and may be called again with the same result.
    """

    def why_not(self, user: "User", robot: "Robot", now: datetime.datetime) -> str:
        """Return why this visitor may not ask for the robot now, as one word that the page has a
        sentence for; empty when they may.
        """
        return ""

    def not_ready(self, user: "User", robot: "Robot", now: datetime.datetime) -> str:
        """Return why the robot is not yet as a session of this visitor needs it, as one word; empty
        when it is, or that is nobody's business.

        Such a session waits, first in the queue, until it is.
        """
        return ""

    def granted(self, session: "Session", now: datetime.datetime) -> Terms | None:
        """Return the terms of a session that gets the robot for the first time; None when it is
        none of the provider's business.

        Raises:
            NotGranted: the session must not begin; it is ended.
        """
        return None

    def claims(self, user: "User", robot: "Robot") -> bool:
        """Tell whether a session that this visitor begins with the robot now would go on terms of
        the provider's.
        """
        return False

    def may_watch(self, user: "User", session: str) -> bool:
        """Tell whether somebody who neither drives nor operates the robot may watch a private
        session of the provider's.
        """
        return False

    def shown(self, session: str) -> dict[str, Any]:
        """Return the `data` of the newest `task` news of a session, for a page that comes back;
        empty when there is none.
        """
        return {}


_providers: list[Provider] = []


def register(provider: Provider) -> None:
    """Have a provider asked from now on; registering twice does nothing."""
    if provider not in _providers:
        _providers.append(provider)


def why_not(user: "User", robot: "Robot", now: datetime.datetime) -> str:
    """Return the first provider's reason against a session; empty when nobody has one."""
    return next(
        (reason for provider in _providers if (reason := provider.why_not(user, robot, now))), ""
    )


def not_ready(user: "User", robot: "Robot", now: datetime.datetime) -> str:
    """Return why a robot is not yet as a session needs it, as Scene.pause says such things; empty
    when it is.
    """
    return next(
        (
            f"{START}: {reason}"
            for provider in _providers
            if (reason := provider.not_ready(user, robot, now))
        ),
        "",
    )


def claims(user: "User", robot: "Robot") -> bool:
    """Tell whether a session that begins now would go on anybody's terms."""
    return any(provider.claims(user, robot) for provider in _providers)


def may_watch(user: "User", session: str) -> bool:
    """Tell whether anybody lets this user watch a private session of another."""
    return any(provider.may_watch(user, session) for provider in _providers)


def of_granted(session: "Session", now: datetime.datetime) -> Terms:
    """Ask the providers for the terms of a session that is granted for the first time.

    Raises:
        NotGranted: the session must not begin.
    """
    return next(
        (terms for provider in _providers if (terms := provider.granted(session, now)) is not None),
        FREE,
    )


def shown(session: str) -> dict[str, Any]:
    """Return what a page that takes a session is shown of its task; empty when there is none."""
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
    """Return terms as `Session.terms` keeps them."""
    found: dict[str, Any] = msgspec.to_builtins(terms)
    return found
