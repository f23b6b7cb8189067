"""A statement and a scale."""

from surveys.item import Item, ScaleItem


class Likert(ScaleItem, frozen=True, kw_only=True, tag="likert"):
    """A statement, answered by a point of a scale."""

    def joins(self, before: Item) -> bool:
        """Statements that follow each other on one scale stand in one frame."""
        return isinstance(before, Likert) and before.scale == self.scale
