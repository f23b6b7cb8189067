"""In words, what a robot waits for between two visits (sessions/leases/readiness.py); for admin,
mail and the researchers' live view.
"""

from django.utils.translation import gettext_lazy as _

WORDS = {
    "dock": _("driving to its charging station"),
    "level": _("levelling its head"),
    "relocalize": _("finding its position"),
    "picture": _("testing its camera"),
    "charging": _("its battery is not charged enough yet"),
    "offline": _("no signal from the robot"),
    "estop": _("its emergency stop is on"),
    "not_connected": _("its control system isn't responding"),
    "fault": _("it has a fault"),
    "network": _("it responds too slowly to be driven"),
    "no_picture": _("no video from its camera"),
    "not_docked": _("it is not docked"),
    "elsewhere": _("it is not at the charging station of the course"),
    "lost": _("it does not know where it is"),
    "charge": _("its battery has less charge than the study requires"),
    "silent": _("it has not reported its state"),
    "no_answer": _("it did not respond in time"),
}


def in_words(reason: str) -> str:
    """Return the reason of a turnaround as a clause; what the robot itself said stays as it was
    said.
    """
    return str(WORDS.get(reason, reason))
