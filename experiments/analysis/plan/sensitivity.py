"""Whether exclusions change what is significant: every declared test with and without them."""

from collections.abc import Iterator, Sequence

from experiments.analysis.tables.table import NOTHING, Table, TableCell, number, probability, words

NAME = "exclusions-effect"
ALPHA = 0.05
HEAD = ("Analysis", "Measure", "Test", "p (Holm), all", "p (Holm), without", "Difference, all")
Key = tuple[str, str, str]


def exclusion_effects(
    every: Sequence[Table], without: Sequence[Table], alpha: float = ALPHA
) -> Table:
    """Return the declared tests on all sessions beside those without excluded ones.

    Args:
        every: the tables of the declared analyses, of all sessions.
        without: the same of those that are not excluded.
        alpha: the level of significance.
    """
    left = dict(_tests(without))
    rows, changed = [], []
    for key, cells in _tests(every):
        other = left.get(key, {})
        p, q = (_p(one) for one in (cells, other))
        is_changed = (p < alpha) != (q < alpha)
        changed += [f"{key[0]}, {key[1]}, {key[2]}"] if is_changed else []
        rows.append(
            (
                *(words(part) for part in key),
                *(probability(p), probability(q), _difference(cells)),
                _difference(other),
                words("changes" if is_changed else "same"),
            )
        )
    head = (*HEAD, "Difference, without", "Significance")
    return Table(
        NAME,
        "Declared tests with and without exclusions.",
        head,
        tuple(rows),
        _said(changed, alpha),
    )


def _said(changed: Sequence[str], alpha: float) -> tuple[str, ...]:
    level = f"Significant: p (Holm) below {alpha:g}."
    if not changed:
        return (level, "The exclusions change the significance of no declared test.")
    return (level, f"The exclusions change the significance of: {'; '.join(changed)}.")


def _tests(tables: Sequence[Table]) -> Iterator[tuple[Key, dict[str, TableCell]]]:
    for table in tables:
        if "p (Holm)" not in table.head:
            continue
        for row in table.rows:
            cells = dict(zip(table.head, row, strict=True))
            label = cells.get("Contrast", cells.get("Effect", words(NOTHING))).text
            yield (table.name.removeprefix("analysis-"), cells["Measure"].text, label), cells


def _p(cells: dict[str, TableCell]) -> float:
    value = cells["p (Holm)"].value if cells else None
    return float("nan") if value is None else value


def _difference(cells: dict[str, TableCell]) -> TableCell:
    return number(cells["Difference"].value if "Difference" in cells else None, 3)
