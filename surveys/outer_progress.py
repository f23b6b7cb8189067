"""The progress of a study around a questionnaire, which apps above this one register and its pages
show.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec

from surveys.definition import Definition
from surveys.models import Response


@dataclass(frozen=True)
class OuterProgress:
    """The title of a study, and which of its steps (from 1) a response is. The page shows
    `step_title` instead of the questionnaire's title. `fill` fills earlier answers into a text.
    """

    title: str
    number: int
    total: int
    step_title: str = ""
    fill: Callable[[str], str] | None = None


# Functions of a response and a language ("es"); None for responses of others.
_sources: list[Callable[[Response, str], OuterProgress | None]] = []
register_outer_progress = _sources.append


def outer_progress_of(response: Response, language: str) -> OuterProgress | None:
    found = (source(response, language) for source in _sources)
    return next((one for one in found if one is not None), None)


def filled_in(definition: Definition, fill: Callable[[str], str]) -> Definition:
    return msgspec.convert(_filled(msgspec.to_builtins(definition), fill), Definition)


def _filled(value: Any, fill: Callable[[str], str]) -> Any:
    if isinstance(value, dict):
        return {key: _filled(one, fill) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_filled(one, fill) for one in value]
    return fill(value) if isinstance(value, str) and "{{" in value else value
