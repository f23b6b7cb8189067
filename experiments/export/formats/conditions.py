"""One line a participant and condition, so that a statistical test needs no merging of tables."""

import math
from collections.abc import Iterable, Iterator, Sequence
from statistics import fmean
from typing import Any

from experiments.analysis.metrics.definitions import METRICS
from experiments.dataset.columns import Column, Tables, amount_of, flag, share
from experiments.dataset.levels import KINDS, OUTCOMES, UNCOUNTED
from experiments.dataset.records import Dataset, ParticipantRecord, SessionRecord
from experiments.export.format import ExportFormat, ExportSource, File
from experiments.models import Drive
from surveys.scoring import ScoredScale, parts_of, scales_of

ABOUT = (
    Column("participant", "", "code of the participant"),
    Column("kind", "", "who took part", levels=KINDS),
    Column("condition", "", "assigned condition"),
    amount_of("order", "", "1 for the participant's first condition, by assignment"),
    amount_of("sessions", "", "drives of the participant in this condition, without practice"),
    flag("counts", "1 when a drive counts in the results on participants"),
    Column(
        "counts_why", "", "why the last drive does not count; empty when one does", levels=UNCOUNTED
    ),
    Column("session", "", "code of the last drive that counts, or of the last one without any"),
    Column("outcome", "", "how that drive ended", levels=OUTCOMES),
)


class ConditionsFormat(ExportFormat):
    """One row per participant and condition, in every export. A value is the mean over the drives
    that count, and of the last drive where none does; scores are of the answers about these drives
    and about the person.
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
    for slug, scale in _scales(dataset):
        low, high = scale.bounds
        meaning = f"score of: {dataset.say(scale.label) or slug} – {scale.formula}"
        scores.append(Column(f"{slug}.{scale.key}", "", meaning, least=low, greatest=high))
    # the mean of a flag is a share
    means = (share(one.name, one.meaning) if one.levels else one for one in METRICS)
    return (*ABOUT[:3], *factors, *ABOUT[3:], *scores, *means)


def _scales(dataset: Dataset) -> Iterator[tuple[str, ScoredScale]]:
    for slug in dict.fromkeys(step.questionnaire for step in dataset.study.questionnaire_steps):
        newest = dataset.questionnaire(slug)
        if newest is not None:
            yield from ((slug, scale) for scale in (*scales_of(newest), *parts_of(newest)))


def condition_rows(source: ExportSource) -> Iterator[Sequence[Any]]:
    """Yield the rows, participant by participant; those who withdrew have none."""
    dataset = source.dataset
    drives: dict[str, dict[str, list[SessionRecord]]] = {}
    for one in dataset.sessions:
        if not one.practice:
            drives.setdefault(one.participant, {}).setdefault(one.condition, []).append(one)
    for person in dataset.participants:
        own = drives.get(person.id, {})
        assigned = [key for key in person.cell.split("-") if key]
        if person.withdrawn:
            continue
        for order, key in enumerate(dict.fromkeys((*assigned, *own)), start=1):
            yield _row(source, person, key, order, own.get(key, []))


def _row(
    source: ExportSource,
    person: ParticipantRecord,
    key: str,
    order: int,
    sessions: Sequence[SessionRecord],
) -> Sequence[Any]:
    dataset = source.dataset
    used = [one for one in sessions if one.counts] or [*sessions[-1:]]
    last = used[-1] if used else None
    condition = dataset.study.condition(key)
    levels = condition.levels if condition is not None else {}
    measured = [source.measured[one.id] for one in used]
    of_last = (False, "not_driven", "", "")
    if last is not None:
        of_last = (last.counts, last.counts_why, last.id, last.outcome)
    return (
        *(person.id, person.kind, key),
        *(levels.get(factor.key, "") for factor in dataset.study.factors),
        *(order, len(sessions), *of_last),
        *_scores(dataset, person.id, {one.id for one in used}),
        *(_mean(one.values[column.name] for one in measured) for column in METRICS),
    )


def _scores(dataset: Dataset, person: str, sessions: set[str]) -> Iterator[float | None]:
    versions = {(one.slug, one.version): one for one in dataset.questionnaires}
    responses = [one for one in dataset.responses if one.participant == person]
    own = [
        (one.questionnaire, version.coded(one.values))
        for one in responses
        if one.session in {"", *sessions}
        and (version := versions.get((one.questionnaire, one.version))) is not None
    ]
    for slug, scale in _scales(dataset):
        yield _mean(scale.score(values) for name, values in own if name == slug)


def _mean(values: Iterable[float | None]) -> float | None:
    known = [one for one in values if one is not None and not math.isnan(one)]
    return fmean(known) if known else None
