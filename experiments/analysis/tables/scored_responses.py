"""The responses to a scored questionnaire as scores count them, grouped by what they are about: a
condition and a robot, because nothing is pooled over either without being named.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from experiments.analysis.tables.response_selection import counted
from experiments.dataset.records import Dataset, ResponseRecord
from surveys.answers import Missing
from surveys.definition import Definition
from surveys.scoring import ScoredScale, parts_of, scales_of

NO_DRIVE = "–"  # in place of condition and robot, of responses that are about no drive


def coded(dataset: Dataset, responses: Sequence[ResponseRecord]) -> list[ResponseRecord]:
    """Return responses whose values are those that scores count: reverse-coded ones from the other
    end, as the version says that was answered.
    """
    return [
        replace(one, values=own.coded(one.values)) if (own := version_of(dataset, one)) else one
        for one in responses
    ]


def version_of(dataset: Dataset, response: ResponseRecord) -> Definition | None:
    """Return the version of a questionnaire that was answered, or the newest without it."""
    own = (response.questionnaire, response.version)
    return next(
        (one for one in dataset.questionnaires if (one.slug, one.version) == own),
        dataset.questionnaire(response.questionnaire),
    )


@dataclass(frozen=True)
class ScoreGroup:
    """Responses about one condition and robot, with coded values. `title` is what notes call the
    condition, which pages show as they are.
    """

    condition: str
    title: str
    robot: str
    responses: tuple[ResponseRecord, ...]

    def scores(self, scale: ScoredScale) -> dict[str, float]:
        """Return each participant's score, over several responses their mean; those who lack an
        answer that it needs have none.
        """
        return mean_scores(self.responses, scale)

    def behind(self, scale: ScoredScale) -> tuple[str, ...]:
        """Return the sessions whose responses have a score."""
        own = (one for one in self.responses if scale.score(one.values) is not None)
        return tuple(one.session for one in own if one.session)

    def asked(self, scale: ScoredScale) -> tuple[str, ...]:
        """Return the items of a scale that anybody in the group was asked."""
        return tuple(
            key for key in scale.items if any(_was_asked(one, key) for one in self.responses)
        )


def mean_scores(responses: Sequence[ResponseRecord], scale: ScoredScale) -> dict[str, float]:
    """Return the mean score of each participant's responses, with coded values."""
    found: dict[str, list[float]] = {}
    for one in responses:
        score = scale.score(one.values)
        if score is not None:
            found.setdefault(one.participant, []).append(score)
    return {who: math.fsum(values) / len(values) for who, values in found.items()}


def _was_asked(response: ResponseRecord, key: str) -> bool:
    if response.values.get(key) is not None:
        return True
    return response.missing.get(key, Missing.NOT_ASKED) != Missing.NOT_ASKED


@dataclass(frozen=True)
class ScoredQuestionnaire:
    """A questionnaire of a study, its scales (the whole, topics, and the parts of the TLX), and the
    responses in groups, in the order of the study's conditions.
    """

    definition: Definition
    scales: tuple[ScoredScale, ...]
    groups: tuple[ScoreGroup, ...]

    def of_condition(self, key: str) -> list[ScoreGroup]:
        """Return the groups of a condition, one a robot."""
        return [group for group in self.groups if group.condition == key]

    @property
    def conditions(self) -> list[str]:
        """The conditions that have responses."""
        found = dict.fromkeys(group.condition for group in self.groups)
        return [key for key in found if key != NO_DRIVE]

    def differing(self, scale: ScoredScale) -> list[str]:
        """Return which items of a scale some groups were not asked and others were, a sentence part
        each; none where the score has the same items everywhere.
        """
        asked = [(_named(group), set(group.asked(scale))) for group in self.groups]
        having = {key: [name for name, keys in asked if key in keys] for key in scale.items}
        return [
            f"{key} only in {', '.join(names)}"
            for key, names in having.items()
            if 0 < len(names) < len(asked)
        ]


def _named(group: ScoreGroup) -> str:
    return f"{group.title} ({group.robot})" if group.condition != NO_DRIVE else "no drive"


def scored_questionnaires(dataset: Dataset) -> Iterator[ScoredQuestionnaire]:
    """Yield the scored questionnaires that were answered, in the order of the study's steps."""
    for slug in dict.fromkeys(step.questionnaire for step in dataset.study.asking):
        definition = dataset.questionnaire(slug)
        scales = (*scales_of(definition), *parts_of(definition)) if definition else ()
        groups = tuple(_groups(dataset, slug)) if scales else ()
        if definition is not None and groups:
            yield ScoredQuestionnaire(definition, scales, groups)


def _groups(dataset: Dataset, slug: str) -> Iterator[ScoreGroup]:
    known = {one.key: dataset.say(one.title) or one.key for one in dataset.study.conditions}
    others = sorted({one.condition for one in dataset.sessions} - set(known))
    robots: Mapping[str, str] = {one.id: one.robot for one in dataset.sessions}
    for key in (*known, *others):
        found: dict[str, list[ResponseRecord]] = {}
        for one in coded(dataset, counted(dataset, slug, key)):
            found.setdefault(robots[one.session], []).append(one)
        for robot, own in sorted(found.items()):
            yield ScoreGroup(key or NO_DRIVE, known.get(key, key), robot, tuple(own))
    apart = tuple(one for one in dataset.responses if one.session not in robots)
    if own := coded(dataset, counted(replace(dataset, responses=apart), slug)):
        yield ScoreGroup(NO_DRIVE, NO_DRIVE, NO_DRIVE, tuple(own))
