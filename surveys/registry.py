"""Families of classes found by name: each module of a package has one of them."""

from collections.abc import Iterable
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType
from typing import TypeVar

import msgspec

T = TypeVar("T")


def family(package: str, path: Iterable[str], base: type[T]) -> dict[str, type[T]]:
    """Return the one subclass of `base` in each module of a package (its `__name__` and `__path__`)
    by the module's name, in alphabetical order. Raises TypeError when a module has none, several,
    or a msgspec class with another tag than its name.
    """
    names = sorted(module.name for module in iter_modules(path))
    return {name: _class_in(import_module(f"{package}.{name}"), name, base) for name in names}


def _class_in(module: ModuleType, name: str, base: type[T]) -> type[T]:
    classes = (one for one in vars(module).values() if isinstance(one, type))
    found = [one for one in classes if one.__module__ == module.__name__ and issubclass(one, base)]
    tags = {one.__struct_config__.tag for one in found if issubclass(one, msgspec.Struct)}
    if len(found) != 1 or not tags <= {name}:
        raise TypeError(f"{module.__name__} needs one subclass of {base.__name__}, named {name!r}")
    return found[0]
