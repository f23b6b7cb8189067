"""The route through a study: which step follows which, round by round, and where a visit begins.

A *visit* is one time of taking part. Steps that are repeated are adjacent and done once for each
condition: a *round* each, counted from 0. The steps before them belong to the first round, those
after them to the last.

Pure. Only the place is stored, and changed only if it is still the one that was read
(experiments/participation/advance.py), so that a reload, the back button or a second tab does
nothing twice.
"""

import re
from collections.abc import Container
from dataclasses import dataclass
from itertools import product

from experiments.definition.schema import StudyDefinition
from experiments.definition.step import Step
from experiments.participation.assignment import Access, cells

_WORD = re.compile(r"([1-9]\d{0,5})\.(\d{1,3})\.([a-z0-9_-]{1,40})\Z", re.ASCII)


class NoPlaceError(ValueError):
    """The word names no place of the study."""


@dataclass(frozen=True)
class JourneyPlace:
    """A participant's place in a study; `visit` counts from 1, `round` from 0."""

    visit: int
    round: int
    step: str

    @property
    def word(self) -> str:
        """The form in which pages send the place back."""
        return f"{self.visit}.{self.round}.{self.step}"


Route = tuple[JourneyPlace, ...]


def step_at(study: StudyDefinition, place: JourneyPlace) -> Step:
    """Return the step at a place; a NoPlaceError when the study has none."""
    found = study.step(place.step)
    if found is None:
        raise NoPlaceError(place.word)
    return found


def rounds(study: StudyDefinition, access: Access) -> int:
    """Return how many conditions a participant does; at least 1, so that every step is passed."""
    return max((len(cell.conditions) for cell in cells(study, access)), default=1)


def route(study: StudyDefinition, number_of_rounds: int, visit: int) -> Route:
    """Return all places of a visit in order, also those that are skipped."""
    keys = [step.key for step in study.steps]
    repeated = [index for index, step in enumerate(study.steps) if step.repeat]
    first, after = (repeated[0], repeated[-1] + 1) if repeated else (len(keys), len(keys))
    last_round = number_of_rounds - 1 if repeated else 0
    before, later = product([0], keys[:first]), product([last_round], keys[after:])
    in_rounds = product(range(number_of_rounds), keys[first:after])
    return tuple(JourneyPlace(visit, n, key) for n, key in (*before, *in_rounds, *later))


def begin(places: Route, skipped: Container[str] = ()) -> JourneyPlace:
    return next((place for place in places if place.step not in skipped), places[-1])


def following(
    places: Route, place: JourneyPlace, skipped: Container[str] = ()
) -> list[JourneyPlace]:
    """Return the places that follow one, none when it was the last; a NoPlaceError for one that is
    not on the route.
    """
    if place not in places:
        raise NoPlaceError(place.word)
    return [later for later in places[places.index(place) + 1 :] if later.step not in skipped]


def read(word: str, places: Route) -> JourneyPlace:
    """Return the place that a page sent back; a NoPlaceError for one that is none of this visit or
    an earlier one.
    """
    match = _WORD.match(word)
    if match is None:
        raise NoPlaceError(word[:80])
    place = JourneyPlace(int(match[1]), int(match[2]), match[3])
    visit = places[0].visit
    if place.visit > visit or JourneyPlace(visit, place.round, place.step) not in places:
        raise NoPlaceError(word[:80])
    return place


def share_done(places: Route, place: JourneyPlace, skipped: Container[str] = ()) -> tuple[int, int]:
    """Return (number, total) of a place, without steps that this visit skips: "step 2 of 6"."""
    passed = [one for one in places if one == place or one.step not in skipped]
    return (passed.index(place) + 1 if place in passed else 1), len(passed)
