"""Several rows on one scale, each a question with an answer of its own, under one heading."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar

from django.utils.translation import gettext_lazy

from surveys.documents import Problem, gettext_noop
from surveys.item import Order, Row, ScaleItem, Scales, ordered


class Grid(ScaleItem, frozen=True, kw_only=True, tag="grid"):
    plain_name: ClassVar[Any] = gettext_lazy("Several statements on one scale")
    labels: ClassVar[Mapping[str, Any]] = {"rows": gettext_lazy("Statements")}
    is_group: ClassVar[bool] = True

    rows: tuple[Row, ...]
    order: Order = "fixed"

    def rows_asked(self, seed: int | None = None) -> Sequence[Row]:
        if seed is None:
            return self.rows
        return ordered(self.rows, self.order, seed, f"rows {self.key}")

    def problems(self, scales: Scales) -> Iterator[Problem]:
        yield from super().problems(scales)
        if not self.rows:
            yield Problem(gettext_noop("There are no statements; add some."))
