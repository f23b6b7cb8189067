"""The terms of visitors who try a simulated robot without an account."""

import datetime

from django.conf import settings

from accounts.models import User
from robots.models import Robot
from sessions.leases.terms import Provider, Terms
from sessions.models import Session


class TrialTerms(Provider):
    """The turn is always limited: other visitors may want to try, and a simulated robot needs much
    of a core. `may_drive` decides which robots they may drive.
    """

    def granted(self, session: Session, now: datetime.datetime) -> Terms | None:
        """Return them for such a visitor; None for all others."""
        if session.visitor.kind != User.Kind.VISITOR:
            return None
        return Terms(turn_seconds=settings.TRIAL_SECONDS, turn_always=True)

    def claims(self, user: User, robot: Robot) -> bool:
        """Tell whether this is such a visitor."""
        return user.kind == User.Kind.VISITOR


TRIAL_TERMS = TrialTerms()
