"""Which responses count, by the rule of the study, and their scores by condition and robot."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from experiments.analysis.tables.comparisons import participant_means
from experiments.analysis.tables.table import amount
from experiments.dataset.grouping import by_key
from experiments.dataset.records import Dataset, ResponseRecord
from surveys.answers import Missing
from surveys.definition import Definition
from surveys.scoring import ScoredScale, parts_of, scales_of

RULES = {
    "first": "Of several responses of one participant the first counts.",
    "last": "Of several responses of one participant the last counts.",
    "all": "Every response counts, also several of one participant.",
}
# Of an interval, by its kind in a study.
DISTRIBUTIONS = {"normal": "the normal", "t": "Student's t"}
NO_DRIVE = "–"  # in place of condition and robot, of responses that are about no drive


def counted(dataset: Dataset, variable: str, condition: str | None = None) -> list[ResponseRecord]:
    """Return the finished responses that count to a variable (StudyDefinition.asked), in the order
    of their sessions. With a condition, those about its sessions: a participant has one that counts
    in each condition. What incomplete participants, who are excluded, answered about themselves is
    for covariates.
    """
    sessions = [one.id for one in dataset.sessions if condition in {None, one.condition}]
    order = {session: place for place, session in enumerate(sessions)}
    excluded = dataset.excluded_people
    own = [
        one
        for one in dataset.answers_to(variable)
        if one.finished and one.participant not in excluded
    ]
    finished = [one for one in own if condition is None or one.session in order]
    finished.sort(key=lambda one: order.get(one.session, -1))
    rule = dataset.study.analysis.counts
    if rule == "all":
        return finished
    in_order = finished if rule == "last" else reversed(finished)
    counting = {one.participant: one.id for one in in_order}
    return [one for one in finished if counting[one.participant] == one.id]


def note(dataset: Dataset, responses: Sequence[ResponseRecord]) -> str:
    """Return the rule, and the numbers of participants and sessions that it leaves."""
    people = len({one.participant for one in responses})
    sessions = len({one.session for one in responses if one.session})
    return (
        f"{RULES[dataset.study.analysis.counts]} {amount(people, 'participant')},"
        f" {amount(sessions, 'session')}, {amount(len(responses), 'response')}."
    )


def coded(dataset: Dataset, responses: Sequence[ResponseRecord]) -> list[ResponseRecord]:
    """Return responses with reverse-coded answers counted from the other end, by the version that
    was answered (by the newest where the dataset lacks that).
    """
    versions = {(one.slug, one.version): one for one in dataset.questionnaires}
    found = []
    for one in responses:
        newest = dataset.questionnaire(one.questionnaire)
        own = versions.get((one.questionnaire, one.version), newest)
        found.append(one if own is None else replace(one, values=own.coded(one.values)))
    return found


@dataclass(frozen=True)
class ScoreGroup:
    """Responses about one condition and robot, with coded values; notes name it by `title`."""

    condition: str
    title: str
    robot: str
    responses: tuple[ResponseRecord, ...]

    def behind(self, scale: ScoredScale) -> tuple[str, ...]:
        own = (one for one in self.responses if scale.score(one.values) is not None)
        return tuple(one.session for one in own if one.session)

    def asked(self, scale: ScoredScale) -> tuple[str, ...]:
        """Return the items of a scale that at least one participant of the group was asked."""
        return tuple(
            key for key in scale.items if any(_was_asked(one, key) for one in self.responses)
        )


def mean_scores(responses: Sequence[ResponseRecord], scale: ScoredScale) -> dict[str, float]:
    """Return each participant's mean score; none without an answer that the score needs."""
    scores = ((one.participant, scale.score(one.values)) for one in responses)
    return participant_means((who, score) for who, score in scores if score is not None)


def _was_asked(response: ResponseRecord, key: str) -> bool:
    if response.values.get(key) is not None:
        return True
    return response.missing.get(key, Missing.NOT_ASKED) != Missing.NOT_ASKED


@dataclass(frozen=True)
class ScoredQuestionnaire:
    """A questionnaire as a variable (StudyDefinition.asked), its scales (whole, topics, parts of
    the TLX), and grouped responses. `about` says at which of several steps it was asked.
    """

    variable: str
    definition: Definition
    scales: tuple[ScoredScale, ...]
    groups: tuple[ScoreGroup, ...]
    about: str = ""

    @property
    def name(self) -> str:
        """The variable in the names of tables."""
        return self.variable.replace(".", "-")

    @property
    def conditions(self) -> list[str]:
        found = dict.fromkeys(group.condition for group in self.groups)
        return [key for key in found if key != NO_DRIVE]

    def differing(self, scale: ScoredScale) -> list[str]:
        """Return which items of a scale only some groups were asked, a part of a sentence each."""
        asked = [(_named(group), group.asked(scale)) for group in self.groups]
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
    for variable in dataset.study.asked:
        definition = dataset.questionnaire(variable)
        if definition is None:
            continue
        scales = (*scales_of(definition), *parts_of(definition))
        groups = tuple(_groups(dataset, variable)) if scales else ()
        if groups:
            about = asked_when(dataset, variable)
            yield ScoredQuestionnaire(variable, definition, scales, groups, about)


def asked_when(dataset: Dataset, variable: str) -> str:
    """Return at which step a questionnaire was asked; nothing where one step alone asks it."""
    step = dataset.study.asked.get(variable)
    if step is None or "." not in variable:
        return ""
    when = dataset.study.when(step)
    return f"Asked at the step {step.key} ({dataset.say(step.title)}), {when}."


def _groups(dataset: Dataset, variable: str) -> Iterator[ScoreGroup]:
    planned = {one.key: dataset.say(one.title) or one.key for one in dataset.study.conditions}
    others = sorted({one.condition for one in dataset.sessions} - set(planned))
    robots = {one.id: one.robot for one in dataset.sessions}
    for key in (*planned, *others):
        responses = coded(dataset, counted(dataset, variable, key))
        found = by_key((robots[one.session], one) for one in responses)
        for robot, own in sorted(found.items()):
            yield ScoreGroup(key or NO_DRIVE, planned.get(key, key), robot, tuple(own))
    apart = tuple(one for one in dataset.responses if one.session not in robots)
    if own := coded(dataset, counted(replace(dataset, responses=apart), variable)):
        yield ScoreGroup(NO_DRIVE, NO_DRIVE, NO_DRIVE, tuple(own))
