"""Success and times under other assumptions about drives that were given up or failed.

Times are censored where a drive ended, as if those who give up would have gone on like the others.
Counted until the time limit, they are drives without success in all of that time (in the terms of
Fine and Gray, JASA 94, 1999: the subdistribution hazard, where nothing else is censored). A drive
that the robot, the network or an operator ended is no success; leaving it out asks about drives in
which the technology worked.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import msgspec

from experiments.analysis.metrics.definitions import KINDS
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.tables.declared import declared
from experiments.analysis.tables.drive_outcomes import OF_SUCCESS
from experiments.analysis.tables.effects import compare_conditions
from experiments.analysis.tables.table import Table, TableCell, number
from experiments.dataset.records import Dataset, SessionRecord

PLANNED, AT_LIMIT, WITHOUT_FAULTS = "as planned", "giving up at the limit", "without faults"
ABOUT = {
    AT_LIMIT: "times of drives that a participant gave up are censored at the time limit, not where"
    " the drive ended",
    WITHOUT_FAULTS: "drives that the robot, the network or an operator ended are left out, which"
    " as planned are drives without success",
}
GAVE_UP = ("", "cancelled")
TECHNICAL = frozenset({"robot", "network", "operator"})  # sides of faults, beside the platform's
PRINTED = ("p (Holm)", "Difference", "Effect", "Size", "Size: from", "Size: to")
HEAD = ("Analysis", "Measure", "Test of", "Drives", "n", *PRINTED, "Significance")
Attempts = Sequence[Measured]
Tests = dict[tuple[str, str, str], dict[str, TableCell]]  # rows by analysis, measure and test


def success_sensitivity(dataset: Dataset, attempts: Attempts, alpha: float) -> Table:
    """Return the tests of success and times as planned, and under each assumption that changes
    drives; no rows where none does.
    """
    changed = dict(_changed(dataset, attempts))
    tests = {label: _tests(dataset, own) for label, own in changed.items()}
    rows = []
    for key, cells in _tests(dataset, attempts).items() if changed else ():
        rows.append((*key, PLANNED, *_printed(cells), ""))
        for label, found in tests.items():
            if label == WITHOUT_FAULTS or KINDS[key[1]] == "times":
                other = found.get(key, {})
                is_same = _is_found(cells, alpha) == _is_found(other, alpha)
                rows.append((*key, label, *_printed(other), "same" if is_same else "changes"))
    notes = [f"{label}: {ABOUT[label]}." for label in changed]
    level = f"Significance: p (Holm) below {alpha:g}."
    title = "Sensitivity analyses of success and times."
    return Table.of("success-sensitivity", title, HEAD, rows, (*notes, level))


def _changed(dataset: Dataset, attempts: Attempts) -> Iterator[tuple[str, list[Measured]]]:
    """Yield the attempts under each assumption that changes some."""
    if any(_gave_up(one.session) for one in attempts):
        task = dataset.study.task
        ends = [one.values["total_time"] for one in attempts]
        limit = max(60.0 * task.minutes if task else 0.0, *filter(math.isfinite, ends), 1.0)
        at_limit = [replace(one, values=one.values | {"total_time": limit}) for one in attempts]
        both = zip(attempts, at_limit, strict=True)
        yield AT_LIMIT, [other if _gave_up(one.session) else one for one, other in both]
    working = [one for one in attempts if one.session.fault_side not in TECHNICAL]
    if len(working) < len(attempts):
        yield WITHOUT_FAULTS, working


def _gave_up(session: SessionRecord) -> bool:
    """Tell whether the participant ended a drive: left, closed the page, or gave no sign; datasets
    of earlier releases have no side.
    """
    return session.fault_side == "visitor" or (session.fault_side, session.outcome) == GAVE_UP


def _tests(dataset: Dataset, attempts: Attempts) -> Tests:
    """Return the tests of success and times: of all conditions, and the declared ones."""
    study = dataset.study
    analyses = tuple(one for one in study.analyses if one.test in OF_SUCCESS)
    planned = replace(dataset, study=msgspec.structs.replace(study, analyses=analyses))
    found: Tests = {}
    for table in (compare_conditions(dataset, attempts), *declared(planned, attempts)):
        if "p (Holm)" in table.head:
            is_declared = table.name.startswith("analysis-")
            for row in table.rows:
                label = row[1].text if is_declared else "all"
                if KINDS.get(row[0].text) in OF_SUCCESS:
                    key = (table.name.removeprefix("analysis-"), row[0].text, label)
                    found[key] = dict(zip(table.head, row, strict=True))
    return found


def _printed(cells: dict[str, TableCell]) -> list[TableCell | str]:
    people = cells.get("n tested") or cells.get("Participants") or number(None, 0)
    return [people, *(cells.get(head, "") for head in PRINTED)]


def _is_found(cells: dict[str, TableCell], alpha: float) -> bool:
    p = cells["p (Holm)"].value if "p (Holm)" in cells else None
    return p is not None and p < alpha
