"""The question types: each module of this package has one, named as its `kind` in a definition.
Nothing outside depends on a single type (CONTRIBUTING.md: how to add one).
"""

from surveys.item import Item
from surveys.registry import family

TYPES = family(__name__, __path__, Item)
