"""The scales of a questionnaire and their scores. Pure.

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

SUS_HIGHEST = 5
SUS_FACTOR = 2.5
WHOLE = "overall"


def sus(answers: Sequence[int | None]) -> float | None:
    """Return the SUS score, 0 to 100, of ten answers in the order of the scale's items; None when
    one is missing.

    Raises:
        ValueError: when there are not ten, or one is not from 1 to 5.
    """
    if len(answers) != 10:
        raise ValueError(f"SUS has 10 items, not {len(answers)}")
    if any(answer is not None and not 1 <= answer <= SUS_HIGHEST for answer in answers):
        raise ValueError(f"SUS answers must be from 1 to {SUS_HIGHEST}")
    given = [answer for answer in answers if answer is not None]
    if len(given) < len(answers):
        return None
    return SUS_FACTOR * sum(
        answer - 1 if n % 2 else SUS_HIGHEST - answer for n, answer in enumerate(given, start=1)
    )


def tlx_raw(ratings: Sequence[float | None]) -> float | None:
    """Return the raw TLX, 0 to 100, of six ratings; None when one is missing.

    Raises:
        ValueError: when there are not six, or one is not from 0 to 100.
    """
    if len(ratings) != 6:
        raise ValueError(f"the TLX has 6 scales, not {len(ratings)}")
    if any(rating is not None and not 0 <= rating <= 100 for rating in ratings):
        raise ValueError("TLX ratings must be from 0 to 100")
    given = [rating for rating in ratings if rating is not None]
    return sum(given) / len(given) if len(given) == len(ratings) else None


@dataclass(frozen=True)
class ScoredScale:
    """Items that make one score.

    Attributes:
        key: a topic's or an item's key; WHOLE for the one of all scored items.
        name: what its score is called in exports.
        label: what it is about; empty for the whole.
        items: the keys of its items, in written order.
        rule: how its score is computed.
        bounds: the least and the greatest score there can be.
    """

    key: str
    name: str
    label: Text
    items: tuple[str, ...]
    rule: ScoringRule
    bounds: tuple[float, float]

    def score(self, coded: Mapping[str, Any]) -> float | None:
        """Return the score of a response, whose values are those of `Definition.coded`; None where
        an answer is missing that the rule needs, or all are.
        """
        given: list[float] = [coded[key] for key in self.items if coded.get(key) is not None]
        if self.rule in {"sus", "tlx_raw"} and len(given) < len(self.items):
            return None
        if self.rule == "sus":
            return SUS_FACTOR * sum(value - 1 for value in given)
        return sum(given) / len(given) if given else None

    @property
    def formula(self) -> str:
        """How `score` computes it, in words."""
        items = ", ".join(self.items)
        if self.rule == "sus":
            return (
                f"{SUS_FACTOR:g} × the sum of (answer − 1) of {items}; empty where one is missing"
            )
        if self.rule == "tlx_raw":
            return f"mean of the answers to {items}, without weights; empty where one is missing"
        return f"mean of the answers to {items} that were given"


def scales_of(definition: Definition) -> tuple[ScoredScale, ...]:
    """Return the scales of a questionnaire, the whole first; none where it is not scored, and no
    whole where nothing says that all items are one scale (`topics`).
    """
    rule, scored = definition.scoring, definition.scored
    if rule == "none":
        return ()
    topics = topic_scales(definition) if rule in {"likert", "topics"} else ()
    if rule == "topics":
        return topics
    items = tuple(question.key for question in scored)
    bounds = (0.0, 100.0) if rule == "sus" else _bounds(definition, items)
    name = "score" if rule == "likert" else rule
    return (ScoredScale(WHOLE, name, {}, items, rule, bounds), *topics)


def topic_scales(definition: Definition) -> tuple[ScoredScale, ...]:
    """Return a scale for each topic: the mean of its items that were answered."""
    return tuple(
        ScoredScale(
            topic.key,
            f"score_{topic.key}",
            topic.text,
            topic.items,
            "topics",
            _bounds(definition, topic.items),
        )
        for topic in definition.topics
    )


def parts_of(definition: Definition) -> tuple[ScoredScale, ...]:
    """Return the six scales of the TLX, which are reported beside their mean; none of others."""
    if definition.scoring != "tlx_raw":
        return ()
    return tuple(item_scale(definition, question) for question in definition.scored)


def measured_scale(definition: Definition, key: str) -> ScoredScale | None:
    """Return the scale that a key names: WHOLE, a topic, or an item by itself; None without one."""
    found = {scale.key: scale for scale in (*topic_scales(definition), *scales_of(definition))}
    question = definition.question(key)
    if question is None or not question.item.is_number:
        return found.get(key)
    return found.get(key) or item_scale(definition, question)


def item_scale(definition: Definition, question: Question) -> ScoredScale:
    """Return the scale that one item is by itself: its score is the answer."""
    keys = (question.key,)
    bounds = _bounds(definition, keys)
    return ScoredScale(question.key, question.key, question.text, keys, "likert", bounds)


def _bounds(definition: Definition, items: Sequence[str]) -> tuple[float, float]:
    known = [question for key in items if (question := definition.question(key)) is not None]
    values = next((question.score_values for question in known if question.score_values), (0, 0))
    return float(values[0]), float(values[-1])


def scores(definition: Definition, values: Mapping[str, Any]) -> dict[str, float | None]:
    """Return the scores of one response by name, from its stored values; none when the
    questionnaire is not scored.

    `likert` gives `score`, the mean of all statements that were answered, and `score_<topic>`
    likewise; `topics` gives the latter alone.
    """
    coded = definition.coded(values)
    return {scale.name: scale.score(coded) for scale in scales_of(definition)}
