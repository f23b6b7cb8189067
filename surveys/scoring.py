"""Scores of the questionnaires that come with a rule of their own. Pure.

- System Usability Scale (Brooke, 1996, "SUS: a quick and dirty usability scale"): ten answers from
  1 to 5; odd items count x - 1, even ones 5 - x; the sum times 2.5 gives 0 to 100.
- Raw NASA-TLX (Hart, 2006, "NASA-Task Load Index; 20 years later"): the mean of the six scales from
  0 to 100, without weights.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from surveys.definition import Definition

SUS_HIGHEST = 5
SUS_FACTOR = 2.5


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


def scores(definition: Definition, values: Mapping[str, Any]) -> dict[str, float | None]:
    """Return the scores of one response by name; none when the questionnaire has no rule of its
    own.

    `likert` gives `score`, the mean of all statements that were answered, and `score_<topic>`
    likewise.
    """
    scored = [question.key for question in definition.scored]
    if definition.scoring == "sus":
        return {"sus": sus([values.get(key) for key in scored])}
    if definition.scoring == "tlx_raw":
        return {"tlx_raw": tlx_raw([values.get(key) for key in scored])}
    if definition.scoring == "likert":
        return {"score": _mean(values, scored)} | {
            f"score_{topic.key}": _mean(values, topic.items) for topic in definition.topics
        }
    return {}


def _mean(values: Mapping[str, Any], keys: Sequence[str]) -> float | None:
    given = [values[key] for key in keys if values.get(key) is not None]
    return sum(given) / len(given) if given else None
