"""A statement and a scale."""

from typing import Any, ClassVar

from django.utils.translation import gettext_lazy

from surveys.item import Item, Row, ScaleItem


class Likert(ScaleItem, frozen=True, kw_only=True, tag="likert"):
    """A statement, answered by a point of a scale; with `reverse`, scores count it from the other
    end.
    """

    plain_name: ClassVar[Any] = gettext_lazy("Statement on a scale")

    reverse: bool = False

    def is_reversed(self, row: Row | None) -> bool:
        """Tell what its definition says."""
        return self.reverse

    def joins(self, before: Item) -> bool:
        """Statements that follow each other on one scale stand in one frame."""
        return isinstance(before, Likert) and before.scale == self.scale
