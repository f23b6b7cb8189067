"""Texts for the reasons of robots (robots/api/reasons.py), for the administration, mail and the
researchers' live view.
"""

from django.utils.translation import gettext

from robots.api.reasons import clause_of


def in_words(reason: str) -> str:
    """Return a reason as a clause; the text of an adapter or an older agent unchanged."""
    return clause_of(reason, gettext)
