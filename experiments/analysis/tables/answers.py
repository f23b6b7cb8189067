"""The final questionnaire by condition: whether participants answered otherwise after one than
after another.

A row is one of Table 5: all statements, a topic, or a statement. A participant's score is the mean
of the row's statements that they answered, as there; the responses that count are chosen by the
study's rule, one a participant and condition unless all count.
"""

import math
from collections.abc import Mapping, Sequence

from experiments.analysis.statistics.conditions import compare
from experiments.analysis.tables.comparisons import ComparedSide, comparison_table
from experiments.analysis.tables.paper_tables import behind, label_of, lines_of
from experiments.analysis.tables.response_selection import RULES
from experiments.analysis.tables.table import Table
from experiments.dataset.records import Dataset, ResponseRecord


def compare_answers(dataset: Dataset) -> Table:
    """Return every row of Table 5 by condition, with a test of the difference."""
    keys = [one.key for one in dataset.study.conditions]
    counted = {key: lines_of(dataset, key) for key in keys}
    keys = [key for key in keys if counted[key][1]]
    lines = counted[keys[0]][0] if keys else []
    is_paired = dataset.study.allocation.design == "within"
    found = []
    for line in lines:
        groups = {
            key: ComparedSide(
                scores(counted[key][1], line.statements), behind(line, counted[key][1])
            )
            for key in keys
        }
        values = {key: group.values for key, group in groups.items()}
        test = compare(values, is_paired=is_paired)
        found.append((label_of(line), test, [*groups.values()]))
    notes = (
        RULES[dataset.study.analysis.counts],
        "A participant's score is the mean of their answers. IQR: third less first quartile.",
        "A topic of one statement is the same test as the statement.",
    )
    return comparison_table("answers", "Final questionnaire by condition.", "", keys, found, notes)


def scores(responses: Sequence[ResponseRecord], statements: Sequence[str]) -> Mapping[str, float]:
    """Return each participant's score; who answered none of the statements has none."""
    found: dict[str, list[float]] = {}
    for one in responses:
        given = [value for key in statements if (value := one.values.get(key)) is not None]
        if given:
            found.setdefault(one.participant, []).append(math.fsum(given) / len(given))
    return {who: math.fsum(values) / len(values) for who, values in found.items()}
