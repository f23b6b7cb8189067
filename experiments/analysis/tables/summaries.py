"""Session metrics as tables, and whether records are good, by rules frozen with the study."""

import math
from collections.abc import Iterator, Mapping, Sequence

from experiments.analysis.metrics.definitions import METRICS, SEGMENT_METRICS, VERSION
from experiments.analysis.metrics.sessions import Measured, Values
from experiments.analysis.statistics.descriptive import spread
from experiments.analysis.tables.table import Table, amount, number, session_count, words
from experiments.dataset.columns import Column
from experiments.dataset.record_quality import faults
from experiments.definition.schema import Quality

OF_SEGMENTS = ("seconds", "path", "efficiency", "stops", "near_seconds", "collisions")
SPREAD = ("n", "Mean", "SD", "p5", "Median", "p95", "IQR")
OF_SESSIONS = (
    "n: sessions, of which a participant may have several. IQR: third less first quartile."
)
Problems = dict[str, str]  # the faults of a record, each with a sentence


def problems_of(one: Measured, rules: Quality) -> Problems:
    """Return for which faults a record is not good, by the requirements of the study."""
    ignored = {"condition": not rules.condition_applied, "operator": not rules.operator_absent}
    found = dict(faults(one.session, one.values, rules))
    return {name: words for name, words in found.items() if not ignored.get(name)}


def metrics_table(measured: Sequence[Measured]) -> Table:
    own = {one.session.id: one.values for one in measured}
    about = f"{_amounts(measured)}; definitions of version {VERSION}."
    notes = (about, OF_SESSIONS, *_about_paths(measured))
    rows = (_spread_row(column, own) for column in METRICS)
    return Table.of("metrics", "Session metrics.", ("Metric", "Unit", *SPREAD), rows, notes)


def _about_paths(measured: Sequence[Measured]) -> Iterator[str]:
    paths = [one.values["path_by_odometry"] for one in measured]
    wheels, position = paths.count(1.0), paths.count(0.0)
    if wheels or position:
        yield (
            f"Path: from odometry in {amount(wheels, 'session')}, from the position without its "
            f"measurement noise in {amount(position, 'session')}. Path, speed and driving times "
            f"cover only the time that has states (seen: its share)."
        )
    if slipped := sum(one.values["slipped"] > 0.0 for one in measured):
        sessions = amount(slipped, "session")
        yield f"Wheels slipped in {sessions}; there the path is from the position."
    if bounded := sum(one.values["efficiency_bounded"] > 0.0 for one in measured):
        yield (
            f"In {amount(bounded, 'session')}, a shortest path was longer than the path driven, "
            f"which is measurement noise: efficiency counts as 1 there."
        )


def _spread_row(column: Column, found: Mapping[str, Values]) -> tuple[object, ...]:
    known = {one: values[column.name] for one, values in found.items()}
    known = {one: value for one, value in known.items() if math.isfinite(value)}
    about = spread(list(known.values()))
    numbers = (about.mean, about.sd, about.p5, about.median, about.p95, about.iqr)
    cells = (number(value, 3, known) for value in numbers)
    return column.name, column.unit, session_count(known), *cells


def sessions_table(measured: Sequence[Measured], problems: Mapping[str, Problems]) -> Table:
    """Return a row a drive of the task, whether it counts or not."""
    head = (
        *("session", "participant", "visit", "number", "robot", "condition", "outcome", "quality"),
        *("counts", "counts_why", "excluded"),
        *(column.name for column in METRICS),
    )
    rows = (
        (
            *(words(one.id, (one.id,)), one.participant, one.visit, one.number),
            *(one.robot, one.condition, one.outcome, " ".join(problems[one.id]) or "good"),
            *(int(one.counts), one.counts_why, one.excluded),
            *(number(found.values[column.name], 3, (one.id,)) for column in METRICS),
        )
        for found in measured
        for one in (found.session,)
    )
    return Table.of("sessions", "Sessions.", head, rows)


def segments_table(measured: Sequence[Measured]) -> Table:
    names = [column.name for column in SEGMENT_METRICS]
    head = ("session", "robot", "condition", "segment", "from", "to", "start", *names)
    rows = (
        (
            *(words(one.id, (one.id,)), one.robot, one.condition),
            *(segment.number, segment.begins, segment.ends, number(segment.start, 1, (one.id,))),
            *(number(segment.values[name], 3, (one.id,)) for name in names),
        )
        for found in measured
        for one in (found.session,)
        for segment in found.segments
    )
    return Table.of("segments", "Segments from checkpoint to checkpoint.", head, rows)


def segment_spreads(measured: Sequence[Measured]) -> Table:
    """Return the spreads of some metrics by robot and segment."""
    groups: dict[tuple[str, int, int, int], dict[str, Values]] = {}
    for one in measured:
        for segment in one.segments:
            key = (one.session.robot, segment.number, segment.begins, segment.ends)
            groups.setdefault(key, {})[one.session.id] = segment.values
    rows = (
        (robot, f"{begins} → {ends}", *_spread_row(column, found))
        for (robot, _, begins, ends), found in sorted(groups.items(), key=lambda one: one[0])
        for column in SEGMENT_METRICS
        if column.name in OF_SEGMENTS
    )
    head = ("Robot", "Segment", "Metric", "Unit", *SPREAD)
    return Table.of("segment-metrics", "Metrics by segment.", head, rows, (OF_SESSIONS,))


def verdicts_table(
    measured: Sequence[Measured], problems: Mapping[str, Problems], others: Sequence[Measured]
) -> Table:
    """Return how many records are good or fail each rule, and why the `others` do not count."""
    order = ("good", "failed", "does not count")
    found: dict[tuple[int, str], list[str]] = {(0, ""): []}
    for one in measured:
        for key in [(1, rule) for rule in problems[one.session.id]] or [(0, "")]:
            found.setdefault(key, []).append(one.session.id)
    for one in others:
        found.setdefault((2, one.session.uncounted_because), []).append(one.session.id)
    rows = ((order[at], rule, session_count(ids)) for (at, rule), ids in sorted(found.items()))
    note = f"{_amounts(measured)}. A record may fail several rules; what fails is kept."
    head = ("", "Rule or reason", "Sessions")
    return Table.of("quality", "Quality of the records.", head, rows, (note,))


def _amounts(measured: Sequence[Measured]) -> str:
    people = len({one.session.participant for one in measured})
    return f"{amount(people, 'participant')}, {amount(len(measured), 'session')}"
