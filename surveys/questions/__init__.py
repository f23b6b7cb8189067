"""The question types, by name: each module of this package is one, and is named as its `kind` in a
definition. Nothing outside a type's own file knows of the type (CONTRIBUTING.md: how to add one).
"""

from surveys.item import Item
from surveys.registry import family

TYPES = family(__name__, __path__, Item)
