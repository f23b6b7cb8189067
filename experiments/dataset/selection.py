"""What goes into a dataset: pseudonymous unless somebody who may decides otherwise. What a
pseudonymous one has of each event, experiments/dataset/allow_list.py says.
"""

from dataclasses import dataclass

from experiments.analysis.dataset import levels

SOURCES = tuple(levels.SOURCES)


@dataclass(frozen=True)
class Selection:
    """What a dataset holds beside numbers and words from lists.

    `identified` adds who the participants are and leaves out nothing; `sources` are those of the
    events, `formats` the names of those that were asked for (experiments/export/formats/).
    """

    identified: bool = False
    free_text: bool = False
    formats: frozenset[str] = frozenset()
    sources: tuple[str, ...] = SOURCES

    @property
    def has_text(self) -> bool:
        """Tell whether free text is kept."""
        return self.identified or self.free_text
