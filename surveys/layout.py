"""In which order somebody sees items, rows and options: as written, or shuffled by the seed that is
stored with the response.

The generator of each list is seeded with the response's seed and the list's name, so that a new
page or option elsewhere changes no other order. Python promises that `random.Random(text)` and
`shuffle` give the same on every version since 3.2.
"""

import random
from collections.abc import Sequence
from typing import TypeVar

from surveys.definition import (
    AnyItem,
    Definition,
    Grid,
    Multiple,
    Option,
    Order,
    Page,
    Question,
    Row,
    Single,
)

T = TypeVar("T")


def ordered(things: Sequence[T], order: Order, seed: int, name: str) -> list[T]:
    """Return things as written, or shuffled by a seed."""
    arranged = list(things)
    if order == "shuffled":
        random.Random(f"{seed}:{name}").shuffle(arranged)
    return arranged


def items_of(page: Page, seed: int) -> list[AnyItem]:
    """Return the items of a page in the order shown."""
    return ordered(page.items, page.order, seed, f"page {page.key}")


def rows_of(grid: Grid, seed: int) -> list[Row]:
    """Return the rows of a grid in the order shown."""
    return ordered(grid.rows, grid.order, seed, f"rows {grid.key}")


def options_of(item: Single | Multiple, seed: int) -> list[Option]:
    """Return the options in the order shown; those that stand alone ("none of these") stay at the
    end.
    """
    usual = [option for option in item.options if not option.alone]
    return ordered(usual, item.order, seed, f"options {item.key}") + [
        option for option in item.options if option.alone
    ]


def questions_shown(definition: Definition, seed: int) -> list[Question]:
    """Return every question in the order in which somebody with this seed meets them."""
    keys: list[str] = []
    for page in definition.pages:
        for item in items_of(page, seed):
            keys += (
                [row.key for row in rows_of(item, seed)] if isinstance(item, Grid) else [item.key]
            )
    return [question for key in keys if (question := definition.question(key)) is not None]


def positions(definition: Definition, seed: int) -> dict[str, int]:
    """Return the place of each question in the order shown, from 1, by key."""
    return {
        question.key: n for n, question in enumerate(questions_shown(definition, seed), start=1)
    }
