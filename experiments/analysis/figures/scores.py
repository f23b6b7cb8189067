"""The scores of a questionnaire: a panel a scale, with participants, means and their intervals."""

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import cycle
from math import ceil
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.analysis.figures import drawing
from experiments.analysis.tables import scored_responses
from experiments.analysis.tables.scores import HEAD, label_of_scale, scores_table
from experiments.analysis.tables.table import Table, TableCell
from experiments.dataset.columns import Floats
from experiments.dataset.records import Dataset
from surveys.scoring import ScoredScale

ROW, AROUND = 0.3, 0.62  # inches: of a condition, and of a panel beside its rows
DEPTH = 0.12  # of a row that equal scores fill, in rows
BELOW = 0.3  # of a row, from the mean to the dots of the participants
DRAWN = (
    "Large markers are means, bars their 95 % confidence intervals (CI95, below), and each small"
    " dot is a participant."
)
LABEL, NO_CONDITION = 40, "all"  # characters of a line of a condition's name
TALLEST = 9.0  # inches: what a page has room for; two columns of panels where one would be higher
TITLE, TITLE_LINE = (95, 42), 0.15  # characters of a line of a panel's title, and its inches


def score_figures(dataset: Dataset) -> Iterator[drawing.Drawing]:
    """Yield a figure for each scored questionnaire that was answered."""
    for found in scored_responses.scored_questionnaires(dataset):
        table = scores_table(dataset, found)
        title = f"{table.title.removesuffix('.')}: participants, mean and 95 % confidence interval."
        name = f"figure-scores-{found.name}"
        with drawing.house_style():
            figure, behind = _draw(dataset, found, table)
        numbers = Table(name, title, HEAD, table.rows, (DRAWN, *table.notes))
        yield drawing.Drawing(figure, numbers, behind)


def _draw(
    dataset: Dataset, found: scored_responses.ScoredQuestionnaire, table: Table
) -> tuple[Figure, drawing.Behind]:
    robots = sorted({group.robot for group in found.groups})
    styles = zip(cycle(drawing.ROBOTS), cycle(drawing.MARKERS), strict=False)
    looks = dict(zip(robots, styles, strict=False))
    count, rows = len(found.scales), len(found.groups)
    # no higher than a page, if two columns are enough for that
    columns = 1 if 0.4 + count * (AROUND + ROW * rows) <= TALLEST else 2
    line = AROUND + (columns - 1) * TITLE_LINE + ROW * rows
    figure, axes = drawing.panels(count, columns, 0.4 + ceil(count / columns) * line)
    behind: drawing.Behind = {}
    for at, (scale, panel) in enumerate(zip(found.scales, axes, strict=True)):
        own = table.rows[at * rows : (at + 1) * rows]
        label = label_of_scale(dataset, found.definition, scale)
        panel.set_title(fill(label, TITLE[columns - 1]), loc="left", fontsize=10.0 - columns)
        _frame(panel, scale, found.groups)
        for place, (group, cells) in enumerate(zip(found.groups, own, strict=True)):
            behind |= _draw_group(panel, place, scale, group, cells, looks[group.robot])
        if at % columns:
            panel.tick_params(labelleft=False)  # the panel beside it names the conditions
    _share_limits(axes, found.scales)
    handles = [
        Line2D([], [], color=colour, marker=marker, label=dataset.robot(robot).title)
        for robot, (colour, marker) in looks.items()
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(robots))
    return figure, behind


def _share_limits(axes: Sequence[Axes], scales: Sequence[ScoredScale]) -> None:
    """Show the same range, with all intervals, in panels whose scales have the same ends."""
    for bounds in {scale.bounds for scale in scales}:
        own = [panel for panel, scale in zip(axes, scales, strict=True) if scale.bounds == bounds]
        low = min(panel.get_xlim()[0] for panel in own)
        high = max(panel.get_xlim()[1] for panel in own)
        margin = 0.01 * (high - low)
        for panel in own:
            panel.set_xlim(low - margin, high + margin)


def _frame(axes: Axes, scale: ScoredScale, groups: Sequence[scored_responses.ScoreGroup]) -> None:
    least, greatest = scale.bounds
    margin = 0.02 * (greatest - least)
    axes.set_xlim(least - margin, greatest + margin)
    labels = [fill(group.title or NO_CONDITION, LABEL) for group in groups]
    axes.set_yticks(range(len(groups)), labels)
    axes.set_ylim(len(groups) - 0.4, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", color=drawing.FAINT, linewidth=0.4)
    axes.set_axisbelow(True)


def _draw_group(
    axes: Axes,
    at: int,
    scale: ScoredScale,
    group: scored_responses.ScoreGroup,
    cells: Sequence[TableCell],
    look: tuple[str, str],
) -> drawing.Behind:
    """Draw a row of the table, and return the sessions behind its mean."""
    mean, low, high = (cells[HEAD.index(name)].value for name in ("Mean", "CI95: from", "CI95: to"))
    if mean is None:
        axes.text(scale.bounds[0], at, "no scores", va="center", fontsize=7, color=drawing.INK)
        return {}
    x, (colour, shape) = sorted(scored_responses.mean_scores(group.responses, scale).values()), look
    axes.scatter(x, at + BELOW + _offsets(x), s=8, color=colour, alpha=0.6, linewidths=0, zorder=2)
    if low is not None and high is not None:
        axes.plot((low, high), (at, at), color=drawing.INK, linewidth=1.4, zorder=3)
        left, right = axes.get_xlim()
        axes.set_xlim(min(left, low), max(right, high))
        axes.plot((low, high), (at, at), "|", color=drawing.INK, markersize=6, zorder=3)
    gid = f"mean-{scale.key}-{group.condition}-{group.robot}"
    (marker,) = axes.plot((mean,), (at,), shape, color=colour, zorder=4, markersize=5, gid=gid)
    marker.set_markeredgecolor(drawing.INK)
    marker.set_markeredgewidth(0.6)
    return {gid: group.behind(scale)}


def _offsets(values: Sequence[float]) -> Floats:
    """Return the offsets of points in their row, in rows: equal ones are beside each other."""
    total, seen, found = Counter(values), Counter[float](), []
    for value in values:
        n = total[value]
        found.append((seen[value] - (n - 1) / 2.0) * min(0.12, 2.0 * DEPTH / max(1, n - 1)))
        seen[value] += 1
    return np.array(found, dtype=np.float64)
