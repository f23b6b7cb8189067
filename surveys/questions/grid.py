"""Several statements on one scale, under one heading."""

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar

from django.utils.translation import gettext_lazy

from surveys.documents import Problem, gettext_noop
from surveys.item import Order, Row, ScaleItem, Scales, ordered


class Grid(ScaleItem, frozen=True, kw_only=True, tag="grid"):
    """Several rows on one scale, each a question with an answer of its own."""

    plain_name: ClassVar[Any] = gettext_lazy("Several statements on one scale")
    is_group: ClassVar[bool] = True

    rows: tuple[Row, ...]
    order: Order = "fixed"

    def rows_asked(self) -> tuple[Row, ...]:
        """Return the rows."""
        return self.rows

    def rows_shown(self, seed: int) -> Sequence[Row]:
        """Return the rows in the order shown."""
        return ordered(self.rows, self.order, seed, f"rows {self.key}")

    def is_reversed(self, row: Row | None) -> bool:
        """Tell what the definition of a row says."""
        return row is not None and row.reverse

    def problems(self, scales: Scales) -> Iterator[Problem]:
        """Yield that its scale is not there, or that it has no rows."""
        yield from super().problems(scales)
        if not self.rows:
            yield Problem(gettext_noop("There are no statements; add some."))
