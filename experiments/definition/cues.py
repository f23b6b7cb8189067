"""The cue that the drive page shows a participant, by situation. Only keys: the page has the texts.
A shown cue is replaced a little later than it would be chosen, so that cues do not flicker.
"""

import math
from dataclasses import dataclass
from typing import Literal, get_args

from experiments.definition.course import CourseTrack, Sight
from experiments.definition.schema import Outcome
from robots.api.messages import Point

CourseKey = Literal["wait_for_picture", "leave_station", "go_to_checkpoint", "wrong_checkpoint"]
TurnKey = Literal["photo_turn_left", "photo_turn_right"]
PhotoKey = Literal[TurnKey, "photo_move", "photo_ready", "photo_review"]
DockingKey = Literal["dock_now", "dock_hold", "dock_again"]
EndKey = Literal["completed", "timed_out", "ended"]
CueKey = Literal[CourseKey, "lost", PhotoKey, "return_home", DockingKey, "docked_early", EndKey]
Window = Literal["shut", "open", "review"]

NEAR_HOME = 1.5  # metres from the station at which the participant is asked to dock
LEAVING = 1.25  # factor on a distance before the cue of a place is replaced
STEADY = 1.15  # factor on the bearing of the mirror before "ready" is replaced
BEHIND = 2.6  # bearing of the mirror, in radians, from which both directions are equally good


@dataclass(frozen=True)
class Cue:
    """A key, the checkpoint that it is about (0: the station), and its place on the map."""

    key: CueKey
    number: int | None = None
    target: Point | None = None


FIRST = Cue("wait_for_picture")
ENDED: dict[Outcome, EndKey] = {"completed": "completed", "timed_out": "timed_out"}


@dataclass(frozen=True)
class Situation:
    """`passed` counts checkpoints, `wrong` is a later one at which the robot is, `home` the
    distance to the station in metres. `early`: it docked before its time; `touching`: the charging
    contacts meet at the end of the course, `dock_contacts` times so far.
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
    """Return the cue of a situation; `shown` is the one before."""
    if situation.outcome is not None:
        return Cue(ENDED.get(situation.outcome, "ended"))
    if not situation.started:
        return FIRST
    if situation.passed < len(track.stops):
        return _to_next_stop(situation, track, shown)
    if situation.touching:
        return Cue("dock_hold", 0, (track.dock.x, track.dock.y))
    return _photo(situation, track, shown) or _home(situation, track, shown)


def _to_next_stop(situation: Situation, track: CourseTrack, shown: Cue | None) -> Cue:
    stop = track.stops[situation.passed]
    target = (stop.x, stop.y)
    if photo := _photo(situation, track, shown):
        return photo
    if situation.docked:
        return Cue("docked_early" if situation.early else "leave_station", stop.number, target)
    if situation.lost:
        return Cue("lost", stop.number, target)
    key: CueKey = "go_to_checkpoint" if situation.wrong is None else "wrong_checkpoint"
    return Cue(key, stop.number, target)


def _photo(situation: Situation, track: CourseTrack, shown: Cue | None) -> Cue | None:
    spot, sight = track.photo, situation.sight
    if spot is None or situation.window == "shut":
        return None
    if situation.window == "review":
        return Cue("photo_review", spot.stop.number)
    key = "photo_move" if sight is None else _hint(sight, spot.view, shown)
    middle = (spot.start[0] + spot.end[0]) / 2.0, (spot.start[1] + spot.end[1]) / 2.0
    return Cue(key, spot.stop.number, middle)


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
    is_docking = shown is not None and shown.key in get_args(DockingKey)
    reach = NEAR_HOME * LEAVING if is_docking else NEAR_HOME
    if situation.home > reach:
        return Cue("return_home", 0, target)
    return Cue("dock_again" if situation.dock_contacts else "dock_now", 0, target)
