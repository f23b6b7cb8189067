"""The measures of declared analyses: a metric, or the score of a questionnaire's item, topic or
whole (`overall`, if its items are one scale), reverse-coded items counted from the other end.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from experiments.analysis.metrics.definitions import KINDS, METRICS
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.statistics.regression import DriveOutcome
from experiments.analysis.tables.comparisons import ComparedSide
from experiments.analysis.tables.drive_outcomes import (
    compared_of,
    drive_side,
    mean_side,
    outcomes,
    sessions_of,
)
from experiments.analysis.tables.paper_tables import behind
from experiments.analysis.tables.scored_responses import coded, counted, mean_scores
from experiments.dataset.records import Dataset
from experiments.definition.analyses import AGE, FAMILIES
from experiments.definition.factors import conditions_together
from surveys.scoring import ScoredScale, measured_scale

NAMES = frozenset(column.name for column in METRICS)


@dataclass(frozen=True)
class StudyMeasures:
    dataset: Dataset
    measured: Sequence[Measured]

    def unknown(self, test: str, measure: str) -> str:
        """Return why a measure has no value: it is misspelt, or the test is not for it."""
        questionnaire, point, item = measure.partition(".")
        if not (self._scale(questionnaire, item) if point else measure in NAMES):
            return "no such measure"
        return f"not one of {test}" if test in FAMILIES and KINDS.get(measure) != test else ""

    def _scale(self, questionnaire: str, item: str) -> ScoredScale | None:
        definition = self.dataset.questionnaire(questionnaire)
        return None if definition is None else measured_scale(definition, item)

    def _sessions(self, condition: str, measure: str) -> list[Measured]:
        own = (one for one in self.measured if one.session.condition == condition)
        return sessions_of(measure, own)

    def means(self, measure: str, condition: str) -> ComparedSide:
        questionnaire, point, item = measure.partition(".")
        if not point:
            own = self._sessions(condition, measure)
            found = mean_side(own, measure) if measure in NAMES else ComparedSide({})
            return found if found.values else ComparedSide({})
        scale = self._scale(questionnaire, item)
        if scale is None:
            return ComparedSide({})
        responses = coded(self.dataset, counted(self.dataset, questionnaire, condition))
        return ComparedSide(mean_scores(responses, scale), behind(scale.items, responses))

    def drives(self, test: str, measure: str, condition: str) -> list[DriveOutcome]:
        """Return a model's observations: each session's outcome, or each participant's mean."""
        if test not in FAMILIES:
            return [DriveOutcome(*one) for one in self.means(measure, condition).values.items()]
        if (kind := KINDS.get(measure)) != test or kind is None:
            return []
        return list(outcomes(self._sessions(condition, measure), kind, measure))

    def side(
        self, test: str, measure: str, keys: Sequence[str]
    ) -> tuple[list[DriveOutcome], ComparedSide]:
        """Return the drives of a contrast's side, of tests of drives, and the side to print. A
        participant's mean is over all conditions of the side that they were to have; participants
        who lack one of these have none.
        """
        if test in FAMILIES:
            driven = (one for one in self.measured if one.session.condition in keys)
            own = compared_of(measure, driven)
            if (kind := KINDS.get(measure)) != test or kind is None:
                return [], ComparedSide({}, [one.session.id for one in own])
            return drive_side(own, kind, measure)
        groups = {key: self.means(measure, key) for key in keys}
        values: dict[str, float] = {}
        for together in conditions_together(self.dataset.study):
            if some := [groups[key].values for key in keys if key in together]:
                shared = set.intersection(*map(set, some))
                values |= {who: sum(one[who] for one in some) / len(some) for who in shared}
        ids = [session for group in groups.values() for session in group.sessions]
        return [], ComparedSide(dict(sorted(values.items())), ids)

    def covariate(self, name: str) -> tuple[dict[str, str | float], tuple[str, ...]]:
        """Return a covariate by participant, and its levels, if any, in their order."""
        if name == AGE:
            return {one.id: one.age for one in self.dataset.participants if one.age == one.age}, ()
        questionnaire, _, item = name.partition(".")
        everybody = replace(self.dataset, exclusions=())  # also the incomplete, who have attempts
        responses = coded(self.dataset, counted(everybody, questionnaire))
        known = (one for one in responses if one.values.get(item) is not None)
        found = {one.participant: one.values[item] for one in known}
        if all(isinstance(value, int | float) for value in found.values()):
            return {who: float(value) for who, value in found.items()}, ()
        definition = self.dataset.questionnaire(questionnaire)
        question = definition.question(item) if definition is not None else None
        levels = [str(value) for value, _ in question.labelled_values] if question else []
        given = {str(value) for value in found.values()}
        ordered = [one for one in levels if one in given] + sorted(given - set(levels))
        return {who: str(value) for who, value in found.items()}, tuple(ordered)
