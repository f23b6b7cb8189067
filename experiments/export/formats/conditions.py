"""One line a participant and condition, so that a statistical test needs no merging of tables. Its
values are of the drives and responses from which a report on participants of the same kind is made.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from statistics import fmean
from typing import Any

from experiments.analysis.metrics.definitions import METRICS
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.tables.drive_outcomes import compared_of
from experiments.analysis.tables.measures import StudyMeasures
from experiments.analysis.tables.scored_responses import asked_when
from experiments.dataset.columns import Column, Tables, amount_of, flag, share
from experiments.dataset.counting import PARTICIPANTS, attempted, counting
from experiments.dataset.grouping import by_key
from experiments.dataset.levels import KINDS, OUTCOMES, UNCOUNTED, Kind
from experiments.dataset.records import COMPLETED, Dataset, ParticipantRecord, SessionRecord
from experiments.definition.factors import steps_about_drive
from experiments.definition.schema import StudyDefinition
from experiments.export.format import ExportFormat, ExportSource, File
from experiments.models import Drive
from surveys.scoring import ScoredScale, parts_of, scales_of

Place = tuple[str, str]  # participant and condition
NO_DRIVE = "no_drive"
ABOUT = (
    Column("participant", "", "code of the participant"),
    Column("kind", "", "who took part", levels=KINDS),
    Column("condition", "", "assigned condition"),
    amount_of("order", "", "1 for the participant's first condition, by assignment"),
    amount_of("sessions", "", "drives of the participant in this condition, without practice"),
    flag("counts", "1 when a drive counts in the results on participants"),
    Column(
        "counts_why",
        "",
        "why the drive in `session` does not count; empty when it does",
        levels={**UNCOUNTED, NO_DRIVE: "the participant has no drive in this condition"},
    ),
    flag(
        "attempted",
        "1 when the results on success and times have the row: a drive counts, or `counts_why` is"
        " a reason for which only these results have it",
    ),
    Column(
        "session",
        "",
        "code of the drive whose success and times the row has; without any, of the last drive",
    ),
    Column("outcome", "", "how that drive ended", levels=OUTCOMES),
)


class ConditionsFormat(ExportFormat):
    """One row per participant and condition, in every export. Success and times are of the drive
    that comparisons have, other metrics the means of the drives that count; scores are of the
    responses that count about these drives, and about the person.
    """

    @classmethod
    def tables_of(cls, dataset: Dataset, _drives: Sequence[Drive]) -> Tables:
        return {"conditions": condition_columns(dataset)}

    def at_last(self) -> Iterator[File]:
        yield self.source.table("conditions", condition_rows(self.source))


def condition_columns(dataset: Dataset) -> tuple[Column, ...]:
    """Return the columns: factors and scores are called as in the study's plan and measures."""
    factors, scores = [], []
    for one in dataset.study.factors:
        levels = {level.key: dataset.say(level.title) for level in one.levels}
        meaning = f"level of the factor: {dataset.say(one.title)}"
        factors.append(Column(f"factor_{one.key}", "", meaning, levels=levels))
    for variable, scale in _scales(dataset):
        low, high = scale.bounds
        meaning = f"score of: {dataset.say(scale.label) or variable} – {scale.formula}"
        if when := asked_when(dataset, variable):
            meaning = f"{meaning}. {when}"
        scores.append(Column(f"{variable}.{scale.key}", "", meaning, least=low, greatest=high))
    # the mean of a flag is a share
    means = (share(one.name, one.meaning) if one.levels else one for one in METRICS)
    return (*ABOUT[:3], *factors, *ABOUT[3:], *scores, *means)


def _scales(dataset: Dataset) -> Iterator[tuple[str, ScoredScale]]:
    """Yield the scales of the questionnaires about drives and about the person, by variable."""
    about_drive = steps_about_drive(dataset.study)
    for variable, step in dataset.study.asked.items():
        newest = dataset.questionnaire(variable)
        if newest is not None and (step.is_about_person or step.key in about_drive):
            yield from ((variable, scale) for scale in (*scales_of(newest), *parts_of(newest)))


def condition_rows(source: ExportSource) -> Iterator[Sequence[Any]]:
    """Yield the rows, participant by participant; those who withdrew have none."""
    own_drives = (one for one in source.dataset.sessions if not one.practice)
    drives = by_key(((one.participant, one.condition), one) for one in own_drives)
    study, found = source.dataset.study, cache(partial(_of_kind, source))
    for person in source.dataset.participants:
        if person.withdrawn:
            continue
        assigned = [key for key in person.cell.split("-") if key]
        conditions = (key for who, key in drives if who == person.id)
        for order, key in enumerate(dict.fromkeys((*assigned, *conditions)), start=1):
            own = drives.get((person.id, key), [])
            yield [*_row(study, found(person.kind), person, key, order, own)]


def _of_kind(source: ExportSource, kind: Kind) -> "_CountedRows":
    """Return what counts of the participants of a kind, as in a report on that kind."""
    dataset = counting(source.dataset, (kind,))
    measured = [replace(source.measured[one.id], session=one) for one in attempted(dataset)]
    attempts = by_key(((one.session.participant, one.session.condition), one) for one in measured)
    keys = {key for _who, key in attempts}
    # covariates are also of incomplete participants, whose attempts count
    whole = replace(dataset, exclusions=())
    scores = [
        {
            key: StudyMeasures(own, measured).means(f"{variable}.{scale.key}", key).values
            for key in keys
        }
        for variable, scale in _scales(dataset)
        for own in [whole if dataset.study.asked[variable].is_about_person else dataset]
    ]
    return _CountedRows(attempts, scores)


@dataclass(frozen=True)
class _CountedRows:
    """The attempts at each place, and of each score its values by condition and participant."""

    attempts: Mapping[Place, Sequence[Measured]]
    scores: Sequence[Mapping[str, Mapping[str, float]]]

    def values(self, who: str, key: str) -> Iterator[float | None]:
        yield from (score.get(key, {}).get(who) for score in self.scores)
        for column in METRICS:
            own = compared_of(column.name, self.attempts.get((who, key), ()))
            yield _mean(one.values[column.name] for one in own)


def _row(
    study: StudyDefinition,
    counted: _CountedRows,
    person: ParticipantRecord,
    key: str,
    order: int,
    sessions: Sequence[SessionRecord],
) -> Iterator[Any]:
    condition = study.condition(key)
    levels = condition.levels if condition is not None else {}
    attempts = compared_of(COMPLETED, counted.attempts.get((person.id, key), ()))
    compared = {one.session.id for one in attempts}
    own = [one for one in sessions if one.id in compared] or [*sessions]
    yield from (person.id, person.kind, key)
    yield from (levels.get(factor.key, "") for factor in study.factors)
    yield from (order, len(sessions))
    if own:
        last, is_attempted = own[-1], bool(attempts) and person.kind in PARTICIPANTS
        yield from (last.counts, last.counts_why, is_attempted, last.id, last.outcome)
    else:
        yield from (False, NO_DRIVE, False, "", "")
    yield from counted.values(person.id, key)


def _mean(values: Iterable[float]) -> float | None:
    known = [one for one in values if not math.isnan(one)]
    return fmean(known) if known else None
