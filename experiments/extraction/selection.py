"""What goes into a dataset: pseudonymous unless somebody who may decides otherwise. What a
pseudonymous one has of each event, experiments/extraction/allow_list.py says.
"""

from dataclasses import dataclass

from experiments.dataset import levels

SOURCES = tuple(levels.SOURCES)


@dataclass(frozen=True)
class Selection:
    """What a dataset holds beside numbers and words from lists.

    `identified` adds who the participants are and leaves out nothing; `sources` are those of the
    events, `formats` the names of those that were asked for (experiments/export/formats/).

    A `public` dataset is for everybody: of the participants who allowed it, where the study asked
    them, with ages as ranges, without numbers from questions about the person, devices and
    networks, and without free text and photos.
    """

    public: bool = False
    identified: bool = False
    free_text: bool = False
    formats: frozenset[str] = frozenset()
    sources: tuple[str, ...] = SOURCES

    def __post_init__(self) -> None:
        if self.public and (self.identified or self.free_text or self.formats):
            raise ValueError("a public dataset has neither names, free text nor other formats")

    @property
    def has_text(self) -> bool:
        """Tell whether free text is kept."""
        return self.identified or self.free_text
