"""Who may operate which session as a hidden operator, and by which script. This app knows no
studies; one that does registers a provider, as for terms (sessions/leases/terms.py).
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from sessions.wizard.script import Script

if TYPE_CHECKING:
    from accounts.models import User
    from robots.models import Robot
    from sessions.models import Session


@dataclass(frozen=True)
class OperatedSession:
    """The facts about a session that an operator may know. `condition` is empty for an operator
    blind to it.
    """

    participant: str
    condition: str
    is_blind: bool
    script: Script


class OperatorProvider(Protocol):
    """The questions to an app above this one; both may use the ORM."""

    def may_operate(self, user: "User", robot: "Robot") -> bool:
        """Tell whether a user is an operator of any study that uses this robot."""

    def operated(self, user: "User", session: "Session") -> OperatedSession | None:
        """Return what an operator may know of a session; None if the user does not operate it."""


_providers: list[OperatorProvider] = []


def register(provider: OperatorProvider) -> None:
    """Add a provider; registering twice has no effect."""
    if provider not in _providers:
        _providers.append(provider)


def may_operate(user: "User", robot: "Robot") -> bool:
    """Tell whether a user may open the operator's page of a robot."""
    return bool(user.is_active) and any(
        provider.may_operate(user, robot) for provider in _providers
    )


def operated(user: "User", session: "Session") -> OperatedSession | None:
    """Return what an operator may know of a session; None if the user does not operate it."""
    found = (provider.operated(user, session) for provider in _providers)
    return next((one for one in found if one is not None), None)
