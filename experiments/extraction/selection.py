"""The choice of a dataset's contents; allow_list.toml lists the pseudonymous parts of each
event.
"""

from dataclasses import dataclass

from experiments.dataset import levels

SOURCES = tuple(levels.SOURCES)


@dataclass(frozen=True)
class Selection:
    """The parts of a dataset besides numbers and words from lists.

    An `identified` dataset has everything, with the names of participants; `sources` are those of
    the events, `formats` the names of the requested formats (experiments/export/formats/).

    A `public` dataset has the participants who allowed it, where the study asked them, with ages as
    ranges, without numbers from questions about the person, devices and networks, and without free
    text and photos.
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
        return self.identified or self.free_text
