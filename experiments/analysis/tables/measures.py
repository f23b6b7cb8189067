"""The measures of declared analyses: a metric, or the score of a questionnaire's item, topic or
whole (`overall`, if its items are one scale), reverse-coded items counted from the other end. Where
several steps ask a questionnaire, each is a variable of its own.
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
from experiments.dataset.counting import attempted
from experiments.dataset.records import Dataset, ResponseRecord
from experiments.definition.analyses import AGE, FAMILIES
from experiments.definition.factors import conditions_together, steps_about_drive
from surveys.scoring import ScoredScale, measured_scale

NAMES = frozenset(column.name for column in METRICS)


@dataclass(frozen=True)
class StudyMeasures:
    """The values of measures for their tests; `unknown` tells which ones have none."""

    dataset: Dataset
    measured: Sequence[Measured]

    def unknown(self, test: str, measure: str) -> str:
        """Return why a measure has no value: it is misspelt, or the test is not for it."""
        variable, point, item = measure.rpartition(".")
        if point and any(name.startswith(f"{variable}.") for name in self.dataset.study.asked):
            return "several steps ask it"
        if not (self._scale(variable, item) if point else measure in NAMES):
            return "no such measure"
        return f"not one of {test}" if test in FAMILIES and KINDS.get(measure) != test else ""

    def _scale(self, variable: str, item: str) -> ScoredScale | None:
        is_asked = variable in self.dataset.study.asked
        definition = self.dataset.questionnaire(variable) if is_asked else None
        return None if definition is None else measured_scale(definition, item)

    def _sessions(self, condition: str, measure: str) -> list[Measured]:
        own = (one for one in self.measured if one.session.condition == condition)
        return sessions_of(measure, own)

    def means(self, measure: str, condition: str) -> ComparedSide:
        variable, point, item = measure.rpartition(".")
        if not point:
            found = mean_side(self._sessions(condition, measure), measure)
            return found if found.values else ComparedSide({})
        scale = self._scale(variable, item)
        if scale is None:
            return ComparedSide({})
        responses = coded(self.dataset, self._responses(variable, condition))
        return ComparedSide(mean_scores(responses, scale), behind(scale.items, responses))

    def _responses(self, variable: str, condition: str) -> list[ResponseRecord]:
        """Return the responses of a condition: those about its drives, or where a questionnaire is
        about the person or several conditions, those of everyone who has a drive in it.
        """
        if self._is_about_drive(variable):
            return counted(self.dataset, variable, condition)
        rows = (one for one in attempted(self.dataset) if one.condition == condition)
        own = {one.participant for one in rows}
        return [one for one in counted(self.dataset, variable) if one.participant in own]

    def _is_about_drive(self, variable: str) -> bool:
        study = self.dataset.study
        return study.asked[variable].key in steps_about_drive(study)

    def drives(self, test: str, measure: str, condition: str) -> list[DriveOutcome]:
        """Return a model's observations: each session's outcome, or each participant's mean; what
        was asked once is an observation of the first condition of which a participant has a drive.
        """
        if test not in FAMILIES:
            values = self.means(measure, condition).values
            variable, point, _item = measure.rpartition(".")
            if point and values and not self._is_about_drive(variable):
                places = self._first_places()
                values = {who: one for who, one in values.items() if places[who] == condition}
            return [DriveOutcome(*one) for one in values.items()]
        return list(outcomes(self._sessions(condition, measure), KINDS[measure], measure))

    def _first_places(self) -> dict[str, str]:
        """Return of each participant's conditions the first, in the order of the study."""
        keys = [one.key for one in self.dataset.study.conditions]
        found = [(one.participant, one.condition) for one in attempted(self.dataset)]
        return {who: key for key in reversed(keys) for who, own in found if own == key}

    def side(
        self, test: str, measure: str, keys: Sequence[str]
    ) -> tuple[list[DriveOutcome], ComparedSide]:
        """Return the drives of a contrast's side, of tests of drives, and the side to print. A
        participant's mean is over all conditions of the side that they were to have; participants
        who lack one of these have none.
        """
        if test in FAMILIES:
            sessions = (one for one in self.measured if one.session.condition in keys)
            return drive_side(compared_of(measure, sessions), KINDS[measure], measure)
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
        variable, _, item = name.rpartition(".")
        everybody = replace(self.dataset, exclusions=())  # also the incomplete, who have attempts
        responses = coded(self.dataset, counted(everybody, variable))
        known = (one for one in responses if one.values.get(item) is not None)
        found = {one.participant: one.values[item] for one in known}
        if all(isinstance(value, int | float) for value in found.values()):
            return {who: float(value) for who, value in found.items()}, ()
        definition = self.dataset.questionnaire(variable)
        question = definition.question(item) if definition is not None else None
        levels = [str(value) for value, _ in question.labelled_values] if question else []
        given = {str(value) for value in found.values()}
        ordered = [one for one in levels if one in given] + sorted(given - set(levels))
        return {who: str(value) for who, value in found.items()}, tuple(ordered)
