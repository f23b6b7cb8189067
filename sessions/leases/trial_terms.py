"""The terms of somebody who tries a simulated robot without an account."""

import datetime

from django.conf import settings

from accounts.models import User
from robots.models import Robot
from sessions.leases.terms import Provider, Terms
from sessions.models import Session


class TrialTerms(Provider):
    """The turn is short, also while nobody waits: others may want to try, and a simulated robot
    costs a good part of a core. Where they may drive is for `may_drive` to say.
    """

    def granted(self, session: Session, now: datetime.datetime) -> Terms | None:
        """Return them for such a visitor; None for everybody else."""
        if session.visitor.kind != User.Kind.VISITOR:
            return None
        return Terms(turn_seconds=settings.TRIAL_SECONDS, turn_always=True)

    def claims(self, user: User, robot: Robot) -> bool:
        """Tell whether it is such a visitor who asks."""
        return user.kind == User.Kind.VISITOR


TRIAL_TERMS = TrialTerms()
