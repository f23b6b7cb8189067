"""The kinds of study steps, by name: each module of this package is one, and is named as its `kind`
in a definition (CONTRIBUTING.md: how to add one).
"""

from importlib import import_module
from pkgutil import iter_modules

from experiments.definition.step import Step


def _kind_of(name: str) -> type[Step]:
    module = import_module(f"{__name__}.{name}")
    found = [
        one
        for one in vars(module).values()
        if isinstance(one, type) and issubclass(one, Step) and one.__module__ == module.__name__
    ]
    if [one.__struct_config__.tag for one in found] != [name]:
        raise TypeError(f"{module.__name__} needs one subclass of Step, with the tag {name!r}")
    return found[0]


KINDS: dict[str, type[Step]] = {
    module.name: _kind_of(module.name) for module in iter_modules(__path__)
}
