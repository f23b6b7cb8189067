"""What the visitor is told next, by situation. Keys only: the words live with the page, in its
languages.

A cue that is shown gives way a little later than it would be chosen, so that none flickers.
"""

import math
from dataclasses import dataclass
from typing import Literal

from experiments.definition.course import CourseTrack, Sight
from experiments.definition.schema import Outcome
from robots.api.messages import Point

CueKey = Literal[
    "wait_for_picture",
    "leave_station",
    "go_to_checkpoint",
    "wrong_checkpoint",
    "photo_turn_left",
    "photo_turn_right",
    "photo_move",
    "photo_ready",
    "photo_review",
    "return_home",
    "dock_now",
    "dock_hold",
    "dock_again",
    "docked_early",
    "lost",
    "completed",
    "timed_out",
    "ended",
]
Window = Literal["shut", "open", "review"]

NEAR_HOME = 1.5  # from here on the visitor is told to dock: metres
LEAVING = 1.25  # how much farther one has to be for a cue of a place to go
STEADY = 1.15  # how much farther the mirror has to be turned away for "ready" to go
BEHIND = 2.6  # with the mirror so far behind either way round will do: radians


@dataclass(frozen=True)
class Cue:
    """A key, the checkpoint that it speaks of (0 is the station), and where on the map that is."""

    key: CueKey
    number: int | None = None
    target: Point | None = None


DOCKING: frozenset[CueKey] = frozenset({"dock_now", "dock_hold", "dock_again"})
FIRST = Cue("wait_for_picture")


@dataclass(frozen=True)
class Situation:
    """What decides. `passed` counts checkpoints, `wrong` is the later one on which the robot
    stands, `home` metres to the station.

    `early` tells that it has been docked before its time, `touching` that the charging contacts
    meet at the end of the course, `dock_contacts` how often they have met there.
    """

    started: bool = False
    outcome: Outcome | None = None
    lost: bool = False
    docked: bool = False
    early: bool = False
    touching: bool = False
    dock_contacts: int = 0
    passed: int = 0
    wrong: int | None = None
    window: Window = "shut"
    sight: Sight | None = None
    home: float = math.inf


def choose(situation: Situation, track: CourseTrack, shown: Cue | None) -> Cue:
    """Return what is told in a situation; `shown` is what was told just before."""
    if situation.outcome is not None:
        return Cue(
            "completed"
            if situation.outcome == "completed"
            else "timed_out"
            if situation.outcome == "timed_out"
            else "ended"
        )
    if not situation.started:
        return FIRST
    if situation.passed < len(track.stops):
        return _on_the_way(situation, track, shown)
    if situation.touching:
        return Cue("dock_hold", 0, (track.dock.x, track.dock.y))
    return _photo(situation, track, shown) or _home(situation, track, shown)


def _on_the_way(situation: Situation, track: CourseTrack, shown: Cue | None) -> Cue:
    stop = track.stops[situation.passed]
    target = (stop.x, stop.y)
    photo = _photo(situation, track, shown)
    if photo is not None:
        return photo
    if situation.docked:
        return Cue("docked_early" if situation.early else "leave_station", stop.number, target)
    if situation.lost:
        return Cue("lost", stop.number, target)
    return Cue(
        "go_to_checkpoint" if situation.wrong is None else "wrong_checkpoint", stop.number, target
    )


def _photo(situation: Situation, track: CourseTrack, shown: Cue | None) -> Cue | None:
    spot, sight = track.photo, situation.sight
    if spot is None or situation.window == "shut":
        return None
    if situation.window == "review":
        return Cue("photo_review", spot.stop.number)
    key = "photo_move" if sight is None else _hint(sight, spot.view, shown)
    return Cue(
        key,
        spot.stop.number,
        ((spot.start[0] + spot.end[0]) / 2.0, (spot.start[1] + spot.end[1]) / 2.0),
    )


def _hint(sight: Sight, view: float, shown: Cue | None) -> CueKey:
    before = shown.key if shown is not None else None
    if not sight.before:
        return "photo_move"
    if abs(sight.bearing) <= (view * STEADY if before == "photo_ready" else view):
        return "photo_ready"
    if before in {"photo_turn_left", "photo_turn_right"} and abs(sight.bearing) > BEHIND:
        return "photo_turn_left" if before == "photo_turn_left" else "photo_turn_right"
    return "photo_turn_left" if sight.bearing > 0.0 else "photo_turn_right"


def _home(situation: Situation, track: CourseTrack, shown: Cue | None) -> Cue:
    target = (track.dock.x, track.dock.y)
    if situation.lost:
        return Cue("lost", 0, target)
    reach = NEAR_HOME * LEAVING if shown is not None and shown.key in DOCKING else NEAR_HOME
    if situation.home > reach:
        return Cue("return_home", 0, target)
    return Cue("dock_again" if situation.dock_contacts else "dock_now", 0, target)
