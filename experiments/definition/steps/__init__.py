"""The kinds of study steps, by name: each module of this package is one, and is named as its `kind`
in a definition (CONTRIBUTING.md: how to add one).
"""

from experiments.definition.step import Step
from surveys.registry import family

KINDS = family(__name__, __path__, Step)
