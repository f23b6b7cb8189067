"""Which profile of the drive page suits a participant, by what they answered about their use of
computers and games.

Driving a robot through a camera is what games train; keys and windows are what computers train. Who
does both at least weekly is offered the page without its explanations, everybody else the one with
the most help. Nobody is offered the technical one: nothing asks about that, and who wants it finds
it.
"""

from collections.abc import Mapping
from typing import Any, Final

from sessions.interfaces import Interface
from surveys.models import Response

QUESTIONNAIRE: Final = "ict"
TRAINED_BY: Final = ("computer", "games")
WEEKLY: Final = 3  # on the questionnaire's scale of five, from 0, never, to 4, daily


def suits(use: Mapping[str, Any]) -> Interface | None:
    """Return the profile for how often somebody uses each thing; what was not answered is absent.
    None when nothing that counts was said.
    """
    told = [use[thing] for thing in TRAINED_BY if isinstance(use.get(thing), int | float)]
    if not told:
        return None
    return "expert" if len(told) == len(TRAINED_BY) and min(told) >= WEEKLY else "novice"


def suggested_to(user: Any) -> Interface | None:
    """Return the profile that suits a visitor by their newest finished answers; None when there are
    none.
    """
    own = Response.objects.filter(
        user=user, questionnaire__slug=QUESTIONNAIRE, finished_at__isnull=False
    )
    newest = own.order_by("-finished_at").only("id").first()
    return (
        suits({item: given.value for item, given in newest.given().items()})
        if newest is not None
        else None
    )
