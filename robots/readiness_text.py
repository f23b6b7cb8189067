"""In words, what a robot waits for between two visits (sessions/leases/readiness.py); for admin,
mail and the researchers' live view.
"""

from django.utils.translation import gettext_lazy as _

WORDS = {
    "dock": _("it drives to its charging station"),
    "level": _("it levels its head"),
    "relocalize": _("it looks for where it is"),
    "picture": _("its camera is tried"),
    "charging": _("its battery is not charged enough yet"),
    "offline": _("it is not heard of"),
    "estop": _("its emergency stop is on"),
    "network": _("it answers too late to be driven"),
    "no_picture": _("its camera gives no picture"),
    "not_docked": _("it is not docked"),
    "elsewhere": _("it is not in the charging station of the course"),
    "lost": _("it does not know where it is"),
    "charge": _("its battery is not charged as the study wants it"),
    "silent": _("it has not said how it is"),
    "no_answer": _("it did not answer in time"),
}


def in_words(reason: str) -> str:
    """Return the reason of a turnaround as a clause; what the robot itself said stays as it was
    said.
    """
    return str(WORDS.get(reason, reason))
