"""The question types, by name: each module of this package is one, and is named as its `kind` in a
definition. Nothing outside a type's own file knows of the type (CONTRIBUTING.md: how to add one).
"""

from surveys.item import Item
from surveys.registry import family


class UnknownQuestionTypeError(LookupError):
    """No module of this package has that name."""


TYPES = family(__name__, __path__, Item)


def question_type(name: str) -> type[Item]:
    """Return the class of a question type.

    Raises:
        UnknownQuestionTypeError: when there is none of that name.
    """
    if name not in TYPES:
        raise UnknownQuestionTypeError(f"there is no question type {name!r}")
    return TYPES[name]
