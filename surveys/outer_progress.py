"""What goes on around a questionnaire, as apps above this one tell it: its page says in what it is
asked, and how far that has come.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec

from surveys.definition import Definition
from surveys.models import Response


@dataclass(frozen=True)
class OuterProgress:
    """What a response belongs to: its title, which of its steps this is, from 1, and what that step
    is called, which its page says instead of the questionnaire's own title. `fill` fills earlier
    answers into a text of the questionnaire.
    """

    title: str
    number: int
    total: int
    step_title: str = ""
    fill: Callable[[str], str] | None = None


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


def filled_in(definition: Definition, fill: Callable[[str], str]) -> Definition:
    """Return a questionnaire as its page shows it, with earlier answers in its texts."""
    return msgspec.convert(_filled(msgspec.to_builtins(definition), fill), Definition)


def _filled(value: Any, fill: Callable[[str], str]) -> Any:
    if isinstance(value, dict):
        return {key: _filled(one, fill) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_filled(one, fill) for one in value]
    return fill(value) if isinstance(value, str) and "{{" in value else value
