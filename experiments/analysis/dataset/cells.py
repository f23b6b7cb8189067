"""Values as they are written into the cells of a dataset's tables."""

import json
import math
from typing import Any

EXACT = 1e15  # whole numbers below it are exact


def as_cell(value: Any) -> Any:
    """Return a value of a record as a cell: 0 and 1, all digits of a number, parts between |."""
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, float):
        return "" if math.isnan(value) else _number(value)
    if isinstance(value, tuple):
        return "|".join(value)
    return (
        json.dumps(value, ensure_ascii=False, sort_keys=True) if isinstance(value, dict) else value
    )


def _number(value: float) -> str:
    return (
        "nan"
        if math.isnan(value)
        else str(int(value))
        if value.is_integer() and abs(value) < EXACT
        else repr(value)
    )
