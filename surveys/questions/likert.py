"""A statement, answered by a point of a scale."""

from typing import Any, ClassVar

from django.utils.translation import gettext_lazy

from surveys.item import ScaleItem


class Likert(ScaleItem, frozen=True, kw_only=True, tag="likert"):
    plain_name: ClassVar[Any] = gettext_lazy("Statement on a scale")

    reverse: bool = False  # scores count it from the other end
