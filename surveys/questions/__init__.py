"""The question types, by name: each module of this package is one, and is named as its `kind` in a
definition. Nothing outside a type's own file knows of the type (CONTRIBUTING.md: how to add one).
"""

from importlib import import_module
from pkgutil import iter_modules

from surveys.item import Item


class UnknownQuestionTypeError(LookupError):
    """No module of this package has that name."""


def _type_of(name: str) -> type[Item]:
    module = import_module(f"{__name__}.{name}")
    found = [
        one
        for one in vars(module).values()
        if isinstance(one, type) and issubclass(one, Item) and one.__module__ == module.__name__
    ]
    if [one.__struct_config__.tag for one in found] != [name]:
        raise TypeError(f"{module.__name__} needs one subclass of Item, with the tag {name!r}")
    return found[0]


TYPES: dict[str, type[Item]] = {
    module.name: _type_of(module.name) for module in iter_modules(__path__)
}


def question_type(name: str) -> type[Item]:
    """Return the class of a question type.

    Raises:
        UnknownQuestionTypeError: when there is none of that name.
    """
    if name not in TYPES:
        raise UnknownQuestionTypeError(f"there is no question type {name!r}")
    return TYPES[name]
