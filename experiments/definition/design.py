"""The factors of a study: what is varied, and whether within or between participants."""

from typing import Annotated, Literal

from msgspec import Meta

from surveys.documents import DocumentPart, Key, Text

Design = Literal["between", "within"]
Levels = dict[Key, Key]  # of a condition: the key of its level, by the key of the factor


class Level(DocumentPart, frozen=True, kw_only=True):
    """A value of a factor."""

    key: Key
    title: Text


class Factor(DocumentPart, frozen=True, kw_only=True):
    """What is varied, such as the delay or the assistance. `within`: a participant has all of its
    levels, `between`: one. The first level is the reference of treatment coding.
    """

    key: Key
    title: Text
    design: Design = "between"
    levels: Annotated[tuple[Level, ...], Meta(max_length=24)] = ()
