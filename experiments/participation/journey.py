"""The way through a study: which step follows which, round by round, and where a visit begins.

A *visit* is one time of taking part. Steps that are repeated stand together and are gone through
once for each condition: a *round* each, counted from 0. The steps before them belong to the first
round, those behind them to the last.

Pure: the study and a place come in, a place goes out. What is stored is the place alone, and it is
changed only by comparing it with what was seen (experiments/participation/progress.py), so that a
reload, the back button or a second tab can do nothing twice.
"""

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass

from experiments.definition.schema import StudyDefinition
from experiments.definition.step import Step
from experiments.participation.assignment import Access, cells

_WORD = re.compile(r"([1-9]\d{0,5})\.(\d{1,3})\.([a-z0-9_-]{1,40})\Z", re.ASCII)


class NoPlaceError(ValueError):
    """The word names no place of the study."""


@dataclass(frozen=True)
class JourneyPlace:
    """Where a participant stands; `visit` counts from 1, `round` from 0."""

    visit: int
    round: int
    step: str

    @property
    def word(self) -> str:
        """The place as pages send it back."""
        return f"{self.visit}.{self.round}.{self.step}"


def step_at(study: StudyDefinition, place: JourneyPlace) -> Step:
    """Return the step at a place.

    Raises:
        NoPlaceError: the study has no such step.
    """
    found = study.step(place.step)
    if found is None:
        raise NoPlaceError(place.word)
    return found


def rounds(study: StudyDefinition, access: Access) -> int:
    """Return how many conditions somebody who came that way goes through; at least 1, so that every
    step is passed.
    """
    return max((len(cell.conditions) for cell in cells(study, access)), default=1)


def route(study: StudyDefinition, number_of_rounds: int, visit: int) -> tuple[JourneyPlace, ...]:
    """Return all places of a visit in order, whether or not some are skipped."""
    return tuple(
        JourneyPlace(visit, number, key) for number, key in _stations(study, number_of_rounds)
    )


def _stations(study: StudyDefinition, number_of_rounds: int) -> Iterator[tuple[int, str]]:
    repeated = [index for index, step in enumerate(study.steps) if step.repeat]
    first, behind = (
        (repeated[0], repeated[-1] + 1) if repeated else (len(study.steps), len(study.steps))
    )
    last = number_of_rounds - 1 if repeated else 0
    yield from ((0, step.key) for step in study.steps[:first])
    for number in range(number_of_rounds):
        yield from ((number, step.key) for step in study.steps[first:behind])
    yield from ((last, step.key) for step in study.steps[behind:])


def begin(way: tuple[JourneyPlace, ...], skipped: Collection[str] = ()) -> JourneyPlace:
    """Return where a visit begins: at its first step that is not skipped."""
    return next((place for place in way if place.step not in skipped), way[-1])


def coming(
    way: tuple[JourneyPlace, ...], place: JourneyPlace, skipped: Collection[str] = ()
) -> list[JourneyPlace]:
    """Return the places that follow one; none when it was the last.

    Raises:
        NoPlaceError: the place is not on the way.
    """
    if place not in way:
        raise NoPlaceError(place.word)
    return [later for later in way[way.index(place) + 1 :] if later.step not in skipped]


def read(word: str, way: tuple[JourneyPlace, ...]) -> JourneyPlace:
    """Return the place that a page sent back.

    Raises:
        NoPlaceError: it is none of this visit's, or of the ones before.
    """
    match = _WORD.match(word)
    if match is None:
        raise NoPlaceError(word[:80])
    place = JourneyPlace(int(match[1]), int(match[2]), match[3])
    visit = way[0].visit
    if place.visit > visit or JourneyPlace(visit, place.round, place.step) not in way:
        raise NoPlaceError(word[:80])
    return place


def share_done(
    way: tuple[JourneyPlace, ...], place: JourneyPlace, skipped: Collection[str] = ()
) -> tuple[int, int]:
    """Return the number of a place, from 1, and how many there are, without the steps that this
    visit skips: "step 2 of 6".
    """
    passed = [one for one in way if one == place or one.step not in skipped]
    return (passed.index(place) + 1 if place in passed else 1), len(passed)
