"""The terms of somebody who tries a simulated robot without an account."""

import datetime
from typing import Any

from django.conf import settings

from accounts.models import User
from robots.models import Robot
from sessions.leases.terms import Terms
from sessions.models import Session


class TrialTerms:
    """The turn is short, also while nobody waits: others may want to try, and a simulated
    robot costs a good part of a core. See sessions.leases.terms.Provider.
    """

    def why_not(self, user: User, robot: Robot, now: datetime.datetime) -> str:
        """Nothing: where they may drive is `may_drive`'s business."""
        return ""

    def not_ready(self, user: User, robot: Robot, now: datetime.datetime) -> str:
        """Nothing."""
        return ""

    def granted(self, session: Session, now: datetime.datetime) -> Terms | None:
        """Return them for such a visitor; None for everybody else."""
        if session.visitor.kind != User.Kind.VISITOR:
            return None
        return Terms(turn_seconds=settings.TRIAL_SECONDS, turn_always=True)

    def claims(self, user: User, robot: Robot) -> bool:
        """Tell whether it is such a visitor who asks."""
        return user.kind == User.Kind.VISITOR

    def may_watch(self, user: User, session: str) -> bool:
        """Nobody: no such visit is private."""
        return False

    def shown(self, session: str) -> dict[str, Any]:
        """Nothing."""
        return {}


TRIAL_TERMS = TrialTerms()
