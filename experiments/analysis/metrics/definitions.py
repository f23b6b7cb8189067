"""What the numbers of a session and of a segment are called, with unit and meaning.

VERSION changes with any definition, so that numbers of two releases are not mixed.

A session that was cut short drove less, collided less and took less time than one that completed
the task, so it is never averaged with others as if it had: `PROPORTIONS` are tested as such; in
place of counts and durations that grow with the time driven (`PER_MINUTE`), comparisons take rates
per minute; `CENSORED` times are at least as long as the session if they never came; and amounts of
the whole task (`OF_COMPLETED`) are those of completed ones.
"""

from collections.abc import Mapping
from typing import Literal

from experiments.dataset.columns import Column, amount_of, flag, share
from experiments.dataset.levels import METHODS, WAYS

VERSION = 4
CLOCK = "by the server's clock"
FROM_START = "from the task's event task_started (the first video frame) to"

DRIVING = (
    amount_of(
        "path",
        "m",
        "distance driven in the time that has states: by the wheels, or by the position on the "
        "map without its measurement noise",
    ),
    flag("path_by_odometry", "1 when the path is by the wheels, 0 when by the position"),
    amount_of(
        "path_unseen",
        "m",
        "minimum distance driven in gaps: by the wheels, or in a straight line; not part of the "
        "path",
    ),
    amount_of(
        "slipped",
        "m",
        "distance that only the wheels turned, while the position did not follow; not part of "
        "the path",
    ),
    amount_of("odometer", "m", "distance driven by the wheels, including gaps and slipping"),
    share("seen", "share of the time that has states; path and speeds cover only this time"),
    amount_of(
        "shortest",
        "m",
        "by how much the shortest paths to the checkpoints became shorter, with the doors as "
        "they were",
    ),
    share(
        "efficiency",
        "shortest, divided by the distance driven in the completed segments, including gaps: 1 is "
        "the shortest path, and the maximum",
    ),
    amount_of(
        "efficiency_bounded",
        "",
        "segments whose shortest path was longer than the path driven, which is measurement "
        "noise; their efficiency counts as 1",
    ),
    amount_of(
        "speed",
        "m/s",
        "mean speed over the time that has states, between first_frame and the end of the task; "
        "the time of a state is its stamp less the median clock_offset of the session",
    ),
    Column("moving_speed", "m/s", "mean speed while the robot moved"),
    amount_of("rotation", "rad", "how far the robot turned, left and right added"),
    amount_of(
        "stops",
        "",
        "number of standstills of 1 s (below 0.02 m/s), seen without a gap, after it went faster "
        "than 0.05 m/s",
    ),
    amount_of("idle", "s", "time without moving or turning"),
    amount_of("collisions", "", "collisions that began"),
    amount_of(
        "near_collisions",
        "",
        "number of times that something came nearer than 0.20 m; each ends at 0.25 m; none counts "
        "in which the robot was docked, as its station is what is near",
    ),
    amount_of("near_seconds", "s", "time of near_collisions"),
    amount_of("least_clearance", "m", "smallest distance to anything"),
    amount_of("jumps", "", "number of jumps of the position without driving"),
)
COMMANDS = (
    amount_of("commands", "", "velocity commands that were applied"),
    amount_of("refused", "", "velocity commands that were refused"),
    share("share_refused", "share of all velocity commands that were refused"),
    share(
        "share_too_old",
        "share of all velocity commands that were refused because they, or their video frames, "
        "were too old",
    ),
    share(
        "share_slowed",
        "share of the commands that were applied that the robot slowed down because of such an age",
    ),
    *(
        Column(f"{name}_speed", "m/s", f"mean speed, forward or backward, that {words}")
        for name, words in (
            ("asked", "the driver asked for"),
            ("allowed", "limits and age allowed"),
            ("applied", "the wheels were then given"),
        )
    ),
    *(share(f"share_{method}", f"share of the commands from: {method}") for method in METHODS),
    *(share(f"share_{way}", f"share of the commands on: {way}") for way in WAYS),
    Column("command_age", "s", "mean age of a command when it was applied"),
    Column("command_age_p95", "s", "95th percentile of the greatest age in a quarter of a second"),
    Column(
        "command_age_median",
        "s",
        "median age of a command, each with the mean of its quarter of a second",
    ),
    Column(
        "answer_age",
        "s",
        "median age, when a command was applied, of the video frame that it answered",
    ),
    Column("answer_age_p95", "s", "95th percentile of that"),
)
LINK = (
    amount_of("round_trip", "s", "median round trip"),
    amount_of("round_trip_p95", "s", "95th percentile of the round trip"),
    share("loss", "mean share of the video packets that were lost"),
    amount_of("fps", "1/s", "mean rate of video frames"),
    amount_of("freezes", "", "freezes of the video"),
    Column("frame_age", "s", "median age of the video"),
    Column("frame_age_p95", "s", "95th percentile of the age of the video"),
)
RECORD = (
    amount_of("rate", "Hz", "states a second"),
    amount_of("gaps", "", "times without a state for longer than 1 s"),
    amount_of("longest_gap", "s", "longest time without a state"),
    amount_of(
        "missing_states",
        "",
        "missing states: gaps in their numbers, or states known to be lost, whichever is greater",
    ),
    Column("clock_offset", "s", "greatest difference of the clocks, in either direction"),
)
METRICS = (
    flag("completed", "1 when the task was completed, 0 when the session ended otherwise"),
    Column(
        "total_time",
        "s",
        f"{FROM_START} its event task_ended; without them from first_frame to ended; {CLOCK}",
    ),
    Column("time_to_motion", "s", f"{FROM_START} first_motion of the session; {CLOCK}"),
    Column(
        "task_time",
        "s",
        f"{FROM_START} its event docked: every checkpoint was passed and the robot was docked after"
        f" it; of sessions that completed the task; {CLOCK}",
    ),
    Column(
        "docking_time",
        "s",
        f"from the task's event of the last checkpoint to its event docked; {CLOCK}",
    ),
    amount_of(
        "docking_attempts",
        "",
        "times the robot came within 0.8 m of its station after the last checkpoint",
    ),
    Column("passed", "", "checkpoints that were passed"),
    flag("photo", "1 when a photo was kept"),
    *DRIVING,
    *COMMANDS,
    *LINK,
    *RECORD,
)
SEGMENT_METRICS = (Column("seconds", "s", "time that it took"), *DRIVING, *COMMANDS, *LINK[:4])
PROPORTIONS = frozenset({"completed", "photo"})
COUNTS = frozenset({"stops", "collisions", "near_collisions", "jumps", "freezes", "commands"})
PER_MINUTE = COUNTS | {"near_seconds", "idle", "rotation", "refused"}
CENSORED = frozenset({"task_time", "time_to_motion"})
OF_COMPLETED = frozenset({"total_time", "path", "odometer", "shortest", "docking_attempts"})
MetricKind = Literal["proportions", "counts", "times"]
KINDS: Mapping[str, MetricKind] = {
    **dict.fromkeys(PROPORTIONS, "proportions"),
    **dict.fromkeys(COUNTS, "counts"),
    **dict.fromkeys(CENSORED, "times"),
}


def unfit_for(test: str, measure: str) -> str:
    """Return which tests a measure has instead of one that does not fit it; nothing if it fits."""
    kind = KINDS.get(measure)
    fitting = [] if kind == "proportions" else ["means", "ranks", "mixed"]
    fitting += [] if kind is None else [kind]
    return "" if test in fitting else ", ".join(fitting)


def label_of(name: str) -> str:
    """Return what a metric is called where it is compared: with its unit where that is a rate, and
    of which sessions it is where that is not all.
    """
    if name in PER_MINUTE:
        return f"{name} per min"
    return f"{name} (completed)" if name in OF_COMPLETED else name
