"""The scores of each scored questionnaire by condition and robot, and the tests between conditions.

A participant is one point: their responses about one condition are averaged. A score is compared
between conditions only where it is computed from the same items in all of them.
"""

from collections import Counter
from collections.abc import Iterator

from experiments.analysis.statistics.comparisons import Test
from experiments.analysis.statistics.conditions import NO_TEST, compare
from experiments.analysis.statistics.descriptive import spread
from experiments.analysis.tables.comparisons import Compared, ComparedSide, comparison_table
from experiments.analysis.tables.paper_tables import OVERALL
from experiments.analysis.tables.scored_responses import (
    DISTRIBUTIONS,
    NO_DRIVE,
    RULES,
    ScoredQuestionnaire,
    ScoreGroup,
    mean_scores,
    scored_questionnaires,
)
from experiments.analysis.tables.table import Table, TableCell, count, number
from experiments.dataset.grouping import by_key
from experiments.dataset.records import Dataset
from experiments.definition.factors import layout_of
from surveys.definition import Definition
from surveys.likert import half_width
from surveys.scoring import WHOLE, ScoredScale

HEAD = (
    *("Scale", "Condition", "Robot", "n", "Mean", "SD", "CI95: from", "CI95: to", "Median", "IQR"),
    *("Least", "Greatest"),
)
RULE_NOTES = {
    "sus": "SUS: 0 to 100 (Brooke, 1996); even statements count in reverse, and a response that"
    " lacks an answer has no score.",
    "tlx_raw": "Raw NASA-TLX: the mean of the six scales without weights (Hart, 2006), 0 to 100; a"
    " response that lacks an answer has no mean.",
    "likert": "A score is the mean of the answers that were given. Overall: all statements, which"
    " the questionnaire declares to be one scale (likert).",
    "topics": "A score is the mean of the answers that were given. Each topic is a scale of its"
    " own; no score pools them.",
}
COLUMNS = (
    "n: participants, whose responses about one condition are averaged. IQR: third less first"
    " quartile. Least, Greatest: what the score can be."
)


def score_tables(dataset: Dataset) -> Iterator[Table]:
    """Yield the scores of each questionnaire, and tests where two conditions have responses. The
    statements of Table 5 are tested in the table `answers`.
    """
    for one in scored_questionnaires(dataset):
        yield scores_table(dataset, one)
        is_in_answers = (
            one.definition.scoring == "likert" and one.variable == dataset.study.statements
        )
        if len(one.conditions) > 1 and not is_in_answers:
            yield score_tests(dataset, one)


def label_of_scale(dataset: Dataset, definition: Definition, scale: ScoredScale) -> str:
    """Return what a scale is called: a topic or an item by its text, the whole by its rule."""
    if scale.key != WHOLE:
        return dataset.say(scale.label)
    return {"sus": "SUS", "tlx_raw": "Raw TLX"}.get(definition.scoring, OVERALL)


def scores_table(dataset: Dataset, found: ScoredQuestionnaire) -> Table:
    definition, analysis = found.definition, dataset.study.analysis
    rows = (
        (
            *(label_of_scale(dataset, definition, scale), group.condition, group.robot),
            *_spread_cells(dataset, scale, group),
            *(number(bound, 0) for bound in scale.bounds),
        )
        for scale in found.scales
        for group in found.groups
    )
    distribution = DISTRIBUTIONS[analysis.interval]
    interval = f"CI95: confidence interval of the mean by {distribution} distribution."
    items = (RULE_NOTES[definition.scoring], *about_items(dataset, found), RULES[analysis.counts])
    notes = (*items, COLUMNS, interval, "Each row is for one condition and one robot.")
    title = f"Scores of {dataset.say(definition.title).removesuffix('.')} ({found.variable})."
    return Table.of(f"scores-{found.name}", title, HEAD, rows, notes)


def _spread_cells(dataset: Dataset, scale: ScoredScale, group: ScoreGroup) -> Iterator[TableCell]:
    scores, ids = mean_scores(group.responses, scale), group.behind(scale)
    about = spread([*scores.values()])
    slack = half_width(about.sd, about.n, 0.95, dataset.study.analysis.interval)
    bounds: tuple[float | None, float | None] = (None, None)
    if about.mean is not None and slack is not None:
        bounds = (about.mean - slack, about.mean + slack)
    yield count(about.n, ids)
    for value in (about.mean, about.sd, *bounds, about.median, about.iqr):
        yield number(value, 2, ids)


def about_items(dataset: Dataset, found: ScoredQuestionnaire) -> Iterator[str]:
    """Yield at which step it was asked, which items are reverse-coded or not asked everywhere, and
    which versions were answered.
    """
    definition = found.definition
    yield from filter(None, [found.about])
    if definition.reversed and definition.scoring != "sus":
        yield f"Reverse-coded, and counted from the other end: {', '.join(definition.reversed)}."
    for scale in found.scales:
        if differing := found.differing(scale):
            label = label_of_scale(dataset, definition, scale)
            yield f"{label} is not of the same items in all rows: {'; '.join(differing)}."
    versions = Counter(one.version for group in found.groups for one in group.responses)
    if len(versions) > 1:
        counts = ", ".join(f"{version} ({n})" for version, n in sorted(versions.items()))
        yield f"Versions are pooled, each scored by its own rules (responses): {counts}."


def score_tests(dataset: Dataset, found: ScoredQuestionnaire) -> Table:
    """Return each score by condition with a test; none if conditions were asked different items."""
    definition = found.definition
    rows = [
        (label_of_scale(dataset, definition, scale), _tested(dataset, found, scale))
        for scale in found.scales
    ]
    items = (RULE_NOTES[definition.scoring], *about_items(dataset, found))
    notes = (*items, *_about_robots(found), RULES[dataset.study.analysis.counts])
    name, step = f"score-tests-{found.name}", f" ({found.variable})" if found.about else ""
    title = f"Scores of {dataset.say(definition.title).removesuffix('.')}{step} by condition."
    return comparison_table(name, title, "", found.conditions, rows, notes)


def _tested(dataset: Dataset, found: ScoredQuestionnaire, scale: ScoredScale) -> Compared:
    sides = {}
    for key in found.conditions:
        own = [group for group in found.groups if group.condition == key]
        responses = [one for group in own for one in group.responses]
        sessions = [one for group in own for one in group.behind(scale)]
        sides[key] = ComparedSide(mean_scores(responses, scale), sessions)
    if differing := found.differing(scale):
        remark = f"not the same items: {', '.join(differing)}"
        return Test(NO_TEST, 0, remark=remark), [*sides.values()]
    values = {key: own.values for key, own in sides.items()}
    is_paired = layout_of(dataset.study, [{key} for key in sides]).is_paired
    return compare(values, is_paired=is_paired), [*sides.values()]


def _about_robots(found: ScoredQuestionnaire) -> Iterator[str]:
    """Yield sentences on comparisons that pool robots, or whose sides have different ones."""
    about_drives = (group for group in found.groups if group.condition != NO_DRIVE)
    robots = by_key((group.title, group.robot) for group in about_drives)
    for title, own in robots.items():
        if len(own) > 1:
            yield f"{title} pools the robots {', '.join(own)}."
    if len({tuple(own) for own in robots.values()}) > 1:
        listed = "; ".join(f"{title}: {', '.join(own)}" for title, own in robots.items())
        yield f"Conditions use different robots, which may explain a difference: {listed}."
