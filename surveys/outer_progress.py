"""What goes on around a questionnaire, as apps above this one tell it: its page says in what it is
asked, and how far that has come.
"""

from collections.abc import Callable
from dataclasses import dataclass

from surveys.models import Response


@dataclass(frozen=True)
class OuterProgress:
    """What a response belongs to: its title, which of its steps this is, from 1, and what that step
    is called, which its page says instead of the questionnaire's own title.
    """

    title: str
    number: int
    total: int
    step_title: str = ""


Teller = Callable[[Response, str], OuterProgress | None]
_tellers: list[Teller] = []


def register_outer_progress(tell: Teller) -> None:
    """Have an app say what a response, in a language ("es"), belongs to; None when it is none of
    its own.
    """
    _tellers.append(tell)


def outer_progress_of(response: Response, language: str) -> OuterProgress | None:
    """Return what a response belongs to; None when it stands alone."""
    told = (tell(response, language) for tell in _tellers)
    return next((found for found in told if found is not None), None)
