"""The scales of a questionnaire, their scores, and the table of answers and scores. Pure.

`likert` declares that all statements are one scale, of which the topics are parts; `topics` that
each topic is a scale of its own. A score of either is the mean of the answers that were given, with
reverse-coded items counted from the other end. Two questionnaires have rules of their own:

- System Usability Scale (Brooke, 1996, "SUS: a quick and dirty usability scale"): ten answers from
  1 to 5; odd items count x - 1, even ones 5 - x; the sum times 2.5 gives 0 to 100.
- Raw NASA-TLX (Hart, 2006, "NASA-Task Load Index; 20 years later"): the mean of the six scales from
  0 to 100, without weights.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from surveys.definition import Definition
from surveys.documents import Text
from surveys.item import Question, ScoringRule

SUS_FACTOR = 2.5
WHOLE = "overall"


@dataclass(frozen=True)
class ScoredScale:
    key: str  # of a topic or an item; WHOLE for that of all scored items
    name: str  # of the score in exports
    label: Text  # empty for the whole
    items: tuple[str, ...]  # keys, in written order
    rule: ScoringRule
    bounds: tuple[float, float]  # the least and the greatest possible score

    def score(self, coded: Mapping[str, Any]) -> float | None:
        """Return the score from `Definition.coded`; None where an answer it needs is missing."""
        given: list[float] = [coded[key] for key in self.items if coded.get(key) is not None]
        if self.rule in {"sus", "tlx_raw"} and len(given) < len(self.items):
            return None
        if self.rule == "sus":
            return SUS_FACTOR * sum(value - 1 for value in given)
        return sum(given) / len(given) if given else None

    @property
    def formula(self) -> str:
        items = ", ".join(self.items)
        if self.rule == "sus":
            words = f"{SUS_FACTOR:g} × the sum of (answer − 1) of {items}"
            return f"{words}; empty where one is missing"
        if self.rule == "tlx_raw":
            return f"mean of the answers to {items}, without weights; empty where one is missing"
        return f"mean of the answers to {items} that were given"


def scales_of(definition: Definition) -> tuple[ScoredScale, ...]:
    """Return the whole (unless scored by `topics`) and the topics; none where it is not scored."""
    rule = definition.scoring
    if rule == "none":
        return ()
    topics = topic_scales(definition) if rule in {"likert", "topics"} else ()
    if rule == "topics":
        return topics
    items = tuple(question.key for question in definition.scored)
    bounds = (0.0, 100.0) if rule == "sus" else _bounds(definition, items)
    name = "score" if rule == "likert" else rule
    return (ScoredScale(WHOLE, name, {}, items, rule, bounds), *topics)


def topic_scales(definition: Definition) -> tuple[ScoredScale, ...]:
    bounds = [_bounds(definition, topic.items) for topic in definition.topics]
    return tuple(
        ScoredScale(one.key, f"score_{one.key}", one.text, one.items, "topics", own)
        for one, own in zip(definition.topics, bounds, strict=True)
    )


def parts_of(definition: Definition) -> tuple[ScoredScale, ...]:
    scored = definition.scored if definition.scoring == "tlx_raw" else ()
    return tuple(_item_scale(definition, question) for question in scored)


def measured_scale(definition: Definition, key: str) -> ScoredScale | None:
    """Return the scale with a key: WHOLE, a topic, or a single item; None when there is none."""
    found = {scale.key: scale for scale in (*topic_scales(definition), *scales_of(definition))}
    question = definition.question(key)
    if key in found or question is None or not question.item.is_number:
        return found.get(key)
    return _item_scale(definition, question)


def _item_scale(definition: Definition, question: Question) -> ScoredScale:
    """Return the scale of a single item, whose score is the answer."""
    key, keys = question.key, (question.key,)
    return ScoredScale(key, key, question.text, keys, "likert", _bounds(definition, keys))


def _bounds(definition: Definition, items: Sequence[str]) -> tuple[float, float]:
    known = (definition.by_key[key].score_values for key in items if key in definition.by_key)
    values = next((values for values in known if values), (0, 0))
    return float(values[0]), float(values[-1])


def scores(definition: Definition, values: Mapping[str, Any]) -> dict[str, float | None]:
    """Return scores of stored values: `score` or the name of the rule, and `score_<topic>`."""
    coded = definition.coded(values)
    return {scale.name: scale.score(coded) for scale in scales_of(definition)}


class WideTable:
    """Answers and scores of responses to any version of a questionnaire. `head` has the columns: of
    each question its value (several in some types) and the reason for none, then the scores.
    """

    def __init__(self, versions: Sequence[Definition]) -> None:
        self._questions = {key: one for each in versions for key, one in each.by_key.items()}
        columns: dict[str, dict[str, None]] = {key: {} for key in self._questions}
        for question in (one for each in versions for one in each.questions()):
            columns[question.key] |= dict.fromkeys(question.item.columns(question.key))
        answers = [one for key, own in columns.items() for one in (*own, f"{key}_missing")]
        self._scores = list(dict.fromkeys(name for each in versions for name in scores(each, {})))
        self.head = answers + self._scores

    def row(
        self, definition: Definition | None, values: Mapping[str, Any], missing: Mapping[str, str]
    ) -> list[Any]:
        """Return the cells of a response in the order of `head`: of stored `values` and of reasons
        why there are none, by key. `definition` is None for a version that is not among them.
        """
        own = definition.by_key if definition is not None else {}
        cells: dict[str, Any] = scores(definition, values) if definition is not None else {}
        for key, question in (self._questions | own).items():
            item = question.item
            cells |= zip(item.columns(key), item.cells(values.get(key)), strict=True)
            cells[f"{key}_missing"] = missing.get(key, "")
        found = (cells.get(column) for column in self.head)
        return ["" if one is None else one for one in found]
