"""Exclusions, and their effect on significance: every declared test with and without them."""

from collections.abc import Iterator, Sequence

from experiments.analysis.tables.declared import PLANNED
from experiments.analysis.tables.table import NOTHING, Table, TableCell, number, probability, words
from experiments.dataset.records import PlanExclusion

LISTED = (
    "Rules of the plan exclude a participant with all sessions; a platform fault or a researcher's"
    " decision excludes one session. Sessions that the platform ended count in no result."
)
HEAD = ("Analysis", "Measure", "Test", "p (Holm)", "p (Holm), all", "Difference")
Key = tuple[str, str, str]


def exclusions_table(found: Sequence[PlanExclusion]) -> Table:
    """Return a row for each exclusion."""
    rows = tuple(
        (
            words(one.participant, (one.session,) if one.session else ()),
            words(one.session),
            words(one.rule),
            words(one.value),
            words("yes" if one.planned else "no"),
        )
        for one in found
    )
    head = ("Participant", "Session", "Rule", "Value", PLANNED)
    return Table("exclusions", "Exclusions.", head, rows, (LISTED,))


def exclusion_effects(planned: Sequence[Table], every: Sequence[Table], alpha: float) -> Table:
    """Return the declared tests on the drives that count beside the same with the excluded ones.

    Args:
        planned: the tables of the declared analyses, of the drives that count.
        every: the same with the excluded drives.
        alpha: the level of significance.
    """
    others = dict(_tests(every))
    rows, changed = [], []
    for key, cells in _tests(planned):
        other = others.get(key, {})
        p, q = (_p(one) for one in (cells, other))
        is_changed = (p < alpha) != (q < alpha)
        changed += [", ".join(key)] if is_changed else []
        rows.append(
            (
                *(words(part) for part in key),
                *(probability(p), probability(q), _difference(cells), _difference(other)),
                words("changes" if is_changed else "same"),
            )
        )
    return Table(
        "exclusions-effect",
        "Sensitivity analysis: declared tests with the excluded drives (all).",
        (*HEAD, "Difference, all", "Significance"),
        tuple(rows),
        _changes(changed, alpha),
    )


def _changes(changed: Sequence[str], alpha: float) -> tuple[str, ...]:
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
