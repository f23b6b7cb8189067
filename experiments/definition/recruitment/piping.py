"""Answers in later texts: `{{questionnaire.item}}` is replaced by the participant's answer,
`{{questionnaire.item|someone}}` by "someone" without one. Control characters and line breaks become
spaces, long answers are cut, and placeholders in answers are not replaced. Templates escape the
result like any other text.
"""

import re
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from surveys.documents import Problem, gettext_noop as _

MOST_CHARACTERS = 200
NO_ANSWER = "–"
_PIPED = re.compile(r"{{\s*([a-z][a-z0-9-]*)\.([a-z][a-z0-9_]*)\s*(?:\|([^{}|]*))?}}")


def filled(text: str, answer: Callable[[str, str], str]) -> str:
    """Fill in the placeholders of a text by `answer(questionnaire, item)`; "" is no answer."""

    def found(match: re.Match[str]) -> str:
        default = (match[3] or NO_ANSWER).strip()
        return plain_line(answer(match[1], match[2])) or default

    return _PIPED.sub(found, text)


def has_piping(text: str) -> bool:
    return _PIPED.search(text) is not None


def plain_line(text: str) -> str:
    """Return one line, without control and format characters that hide or reverse words."""
    seen = "".join(" " if unicodedata.category(one)[0] in "CZ" else one for one in text)
    line = " ".join(seen.split())
    return line if len(line) <= MOST_CHARACTERS else line[: MOST_CHARACTERS - 1] + "…"


def piping_problems(steps: Iterable[Any]) -> Iterator[Problem]:
    """Yield placeholders for questionnaires that no earlier step asks."""
    asked: set[str] = set()
    for step in steps:
        for name, item in sorted(_placeholders(step)):
            if name not in asked:
                words = _(
                    "The step %(step)s refers to the answer %(answer)s, but no earlier step asks "
                    "that questionnaire."
                )
                yield Problem(words, {"step": step.key, "answer": f"{name}.{item}"})
        asked.add(getattr(step, "questionnaire", ""))


def _placeholders(part: Any) -> set[tuple[str, str]]:
    if isinstance(part, str):
        return {(match[1], match[2]) for match in _PIPED.finditer(part)}
    if isinstance(part, dict):
        return _placeholders(list(part.values()))
    if isinstance(part, Sequence):
        return set().union(*(_placeholders(one) for one in part))
    names = getattr(part, "__struct_fields__", ())
    return _placeholders([getattr(part, name) for name in names])
