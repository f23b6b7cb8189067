"""Session metrics as tables: spreads over all sessions, a row a session, a row a segment, and the
spreads of each segment.
"""

import math
from collections.abc import Iterator, Mapping, Sequence

from experiments.analysis.metrics.definitions import METRICS, SEGMENT_METRICS, VERSION
from experiments.analysis.metrics.sessions import CheckpointSegment, Measured, Values
from experiments.analysis.statistics.descriptive import spread
from experiments.analysis.tables.reliability import QualityVerdict
from experiments.analysis.tables.table import Table, TableCell, amount, count, number, words
from experiments.dataset.columns import Column

OF_SEGMENTS = ("seconds", "path", "efficiency", "stops", "near_seconds", "collisions")
SPREAD = ("n", "Mean", "SD", "p5", "Median", "p95", "IQR")
OF_SESSIONS = (
    "n: sessions, of which a participant may have several. IQR: third less first quartile."
)


def metrics_table(measured: Sequence[Measured]) -> Table:
    """Return how every metric is spread over the sessions in which it is known."""
    rows = tuple(
        _spread_row(column, [(one.session.id, one.values) for one in measured])
        for column in METRICS
    )
    below = (
        f"{_amounts(measured)}; definitions of version {VERSION}.",
        OF_SESSIONS,
        *_about_paths(measured),
    )
    return Table("metrics", "Session metrics.", ("Metric", "Unit", *SPREAD), rows, below)


def _about_paths(measured: Sequence[Measured]) -> Iterator[str]:
    """Yield what paths and efficiencies are made of, in sentences."""
    paths = [one.values["path_by_odometry"] for one in measured]
    wheels, position = paths.count(1.0), paths.count(0.0)
    if wheels or position:
        yield (
            f"Path: from odometry in {amount(wheels, 'session')}, from the position without its "
            f"measurement noise in {amount(position, 'session')}. Path, speed and driving times "
            f"cover only the time that has states (seen: its share)."
        )
    slipped = sum(one.values["slipped"] > 0.0 for one in measured)
    if slipped:
        yield (
            f"Wheels slipped in {amount(slipped, 'session')}; there the path is from the position."
        )
    bounded = sum(one.values["efficiency_bounded"] > 0.0 for one in measured)
    if bounded:
        yield (
            f"In {amount(bounded, 'session')}, a shortest path was longer than the path driven, "
            f"which is measurement noise: efficiency counts as 1 there."
        )


def _spread_row(
    column: Column, found: Sequence[tuple[str, Values]], *before: TableCell
) -> tuple[TableCell, ...]:
    known = [
        (session, values[column.name])
        for session, values in found
        if math.isfinite(values[column.name])
    ]
    ids = [session for session, _ in known]
    about = spread([value for _, value in known])
    cells = (
        number(value, 3, ids)
        for value in (about.mean, about.sd, about.p5, about.median, about.p95, about.iqr)
    )
    return *before, words(column.name), words(column.unit), count(about.n, ids), *cells


def sessions_table(measured: Sequence[Measured], verdicts: Mapping[str, QualityVerdict]) -> Table:
    """Return a row a drive of the task, whether it counts or not: who, where, how it ended, whether
    its record is good, why it does not count, and every metric.
    """
    head = (
        *("session", "participant", "visit", "number", "robot", "condition", "outcome", "quality"),
        *("counts", "counts_why", "excluded"),
        *(column.name for column in METRICS),
    )
    rows = tuple(_session_row(one, verdicts[one.session.id]) for one in measured)
    return Table("sessions", "Sessions.", head, rows)


def _session_row(one: Measured, verdict: QualityVerdict) -> tuple[TableCell, ...]:
    session, own = one.session, (one.session.id,)
    quality = "good" if verdict.good else " ".join(word for word, _ in verdict.problems)
    about = (session.robot, session.condition, session.outcome, quality)
    return (
        *(words(session.id, own), words(session.participant)),
        *(count(session.visit), count(session.number)),
        *(words(text) for text in about),
        *(count(int(session.counts)), words(session.counts_why), words(session.excluded)),
        *(number(one.values[column.name], 3, own) for column in METRICS),
    )


def segments_table(measured: Sequence[Measured]) -> Table:
    """Return a row a segment of each session."""
    head = (
        "session",
        "robot",
        "condition",
        "segment",
        "from",
        "to",
        "start",
        *(column.name for column in SEGMENT_METRICS),
    )
    rows = tuple(_segment_row(one, segment) for one in measured for segment in one.segments)
    return Table("segments", "Segments from checkpoint to checkpoint.", head, rows)


def _segment_row(one: Measured, segment: CheckpointSegment) -> tuple[TableCell, ...]:
    own = (one.session.id,)
    about = (
        words(one.session.id, own),
        words(one.session.robot),
        words(one.session.condition),
        count(segment.number),
    )
    numbers = (number(segment.values[column.name], 3, own) for column in SEGMENT_METRICS)
    return (
        *about,
        count(segment.begins),
        count(segment.ends),
        number(segment.start, 1, own),
        *numbers,
    )


def segment_spreads(measured: Sequence[Measured], names: Sequence[str] = OF_SEGMENTS) -> Table:
    """Return how some metrics are spread over the sessions that finished each segment, robot by
    robot.
    """
    wanted = [column for column in SEGMENT_METRICS if column.name in names]
    groups: dict[tuple[str, int, int, int], list[tuple[str, Values]]] = {}
    for one in measured:
        for segment in one.segments:
            groups.setdefault(
                (one.session.robot, segment.number, segment.begins, segment.ends), []
            ).append((one.session.id, segment.values))
    rows = [
        _spread_row(column, found, words(robot), words(f"{begins} → {ends}"))
        for (robot, _, begins, ends), found in sorted(groups.items())
        for column in wanted
    ]
    return Table(
        "segment-metrics",
        "Metrics by segment.",
        ("Robot", "Segment", "Metric", "Unit", *SPREAD),
        tuple(rows),
        (OF_SESSIONS,),
    )


def verdicts_table(
    measured: Sequence[Measured],
    verdicts: Mapping[str, QualityVerdict],
    others: Sequence[Measured] = (),
) -> Table:
    """Return how many records of the drives that count are good, how many fail each rule, and why
    the `others` do not count.
    """
    found: dict[tuple[str, str], list[str]] = {("good", ""): []}
    for one in measured:
        rules = [word for word, _ in verdicts[one.session.id].problems]
        for key in [("failed", word) for word in rules] or [("good", "")]:
            found.setdefault(key, []).append(one.session.id)
    for one in others:
        key = ("does not count", one.session.uncounted_because)
        found.setdefault(key, []).append(one.session.id)
    order = ("good", "failed", "does not count")
    rows = tuple(
        (words(label), words(rule), count(len(ids), ids))
        for (label, rule), ids in sorted(
            found.items(), key=lambda one: (order.index(one[0][0]), one[0][1])
        )
    )
    below = f"{_amounts(measured)}. A record may fail several rules; what fails is kept."
    head = ("", "Rule or reason", "Sessions")
    return Table("quality", "Quality of the records.", head, rows, (below,))


def _amounts(measured: Sequence[Measured]) -> str:
    people = len({one.session.participant for one in measured})
    return f"{amount(people, 'participant')}, {amount(len(measured), 'session')}"
