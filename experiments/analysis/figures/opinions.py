"""Figure 8 of the paper: the final questionnaire. (a) means with intervals, and the shares of the
answers (in the paper, each bar is as long as the mean and divided by the shares, which cannot be
read where the mean is near 0); (b) bars of 100 %.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from textwrap import fill

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from experiments.analysis.figures import drawing
from experiments.analysis.statistics.descriptive import ROUNDED, shares
from experiments.analysis.tables.paper_tables import (
    behind,
    label_of,
    lines_of,
    notes_of,
    scale_of,
    signed,
)
from experiments.analysis.tables.scored_responses import note
from experiments.analysis.tables.table import Table, count, number
from experiments.dataset.records import Dataset, ResponseRecord
from surveys.likert import LikertRow

BAR = 0.72
ROW, ROW_OF_MEANS = 0.27, 0.36  # inches
BELOW, ABOVE = 0.14, 0.3  # of a row, from its middle to the discs and to the mean
WHOLE = 330.0  # square points: the disc of all answers
DISC: drawing.Look = {"facecolor": "#c9dcec", "edgecolor": "#54697c", "linewidths": 0.5}
POINT: drawing.Look = {"marker": "D", "markersize": 3.4, "color": drawing.INK, "linestyle": "none"}
INTERVAL: drawing.Look = {"ecolor": drawing.INK, "elinewidth": 1.1, "capsize": 2.2, "fmt": "none"}
# Both sides of a balance; the lower one is hatched, for grey prints.
LOOKS: tuple[drawing.Look, drawing.Look] = (
    {"facecolor": drawing.NEGATIVE, "edgecolor": drawing.INK, "linewidth": 0.3, "hatch": "////"},
    {"facecolor": drawing.POSITIVE, "edgecolor": drawing.INK, "linewidth": 0.3, "hatch": ""},
)
LEAST_LABELLED = 6.0  # per cent, below which no number fits into a bar
LABEL = 52  # characters of a line beside the bars
LINE = 0.115  # inches


def figure_8a(dataset: Dataset) -> drawing.Drawing:
    """Draw each row of Table 5: its mean with the interval, and below a disc at each value of the
    scale, whose area is the share of the answers.
    """
    lines, responses = lines_of(dataset)
    labels = scale_of(dataset)
    scale = tuple(labels)
    found: drawing.Behind = {}
    with drawing.house_style():
        figure, axes = _canvas(dataset, lines, ROW_OF_MEANS)
        for at, line in enumerate(lines):
            found |= _mean_and_shares(axes, at, line, responses, scale)
        if lines:
            margin = 0.12 * (scale[-1] - scale[0])
            axes.set_xlim(scale[0] - margin, scale[-1] + margin)
            named = (f"{signed(value)} {label}".strip() for value, label in labels.items())
            axes.set_xticks(scale, [fill(name, 12) for name in named])
            axes.grid(axis="x", color=drawing.FAINT, linewidth=0.4)
            axes.set_axisbelow(True)
            figure.legend(handles=_keys(), loc="outside lower center", ncols=3, handletextpad=0.8)
    rows = []
    for line in lines:
        about, summary = behind(line.statements, responses), line.summary
        parts = shares(summary.counts) or (None,) * len(scale)
        means = (number(value, 2, about) for value in (summary.mean, summary.ci95))
        n = count(summary.respondents, about)
        rows.append((label_of(line), n, *means, *(number(part, 1, about) for part in parts)))
    title = (
        "Final questionnaire: means with their 95 % confidence intervals, and below them the share"
        " of the answers at each value of the scale."
    )
    head = ("", "n", "mean", "CI95", *(f"% {signed(value)}" for value in scale))
    numbers = Table.of("figure-8a", title, head, rows, notes_of(dataset, responses))
    return drawing.Drawing(figure, numbers, found)


def _mean_and_shares(
    axes: Axes, at: int, line: LikertRow, responses: Sequence[ResponseRecord], scale: Sequence[int]
) -> drawing.Behind:
    mean, half, parts = line.summary.mean, line.summary.ci95, line.summary.percentages
    if mean is None or parts is None:
        axes.text(scale[0], at, "no answers", va="center", fontsize=7, color=drawing.INK)
        return {}
    found: drawing.Behind = {}
    for value, part in zip(scale, parts, strict=True):
        if part > 0.0:
            key = f"value{value}-{line.kind}-{line.key}"
            axes.scatter((value,), (at + BELOW,), s=WHOLE * part / 100.0, **DISC, gid=key)
            found[key] = behind(line.statements, responses, (value,))
    key = f"mean-{line.kind}-{line.key}"
    axes.plot((mean,), (at - ABOVE,), **POINT, gid=key)
    found[key] = behind(line.statements, responses)
    text = f"{mean:.2f}".replace("-", "−")
    if half is not None:
        axes.errorbar((mean,), (at - ABOVE,), xerr=(half,), **INTERVAL)
        text += f" ± {half:.2f}"
    where = axes.get_yaxis_transform()
    axes.text(1.01, at - ABOVE, text, transform=where, va="center", fontsize=7)
    return found


def _keys() -> list[Line2D]:
    colours = {"markerfacecolor": DISC["facecolor"], "markeredgecolor": DISC["edgecolor"]}
    look = drawing.Look(linestyle="none", marker="o", markeredgewidth=DISC["linewidths"], **colours)
    discs = [
        Line2D([], [], **look, markersize=math.sqrt(WHOLE * part / 100.0), label=label)
        for part, label in ((10, "10 % of the answers"), (50, "50 % of the answers"))
    ]
    return [Line2D([], [], **{**POINT, "linestyle": "-"}, label="mean and 95 % CI"), *discs]


def figure_8b(dataset: Dataset) -> drawing.Drawing:
    """Draw a bar of 100 % for each row of Table 5: non-positive against positive answers."""
    lines, responses = lines_of(dataset)
    scale = tuple(scale_of(dataset))
    middle = (scale[0] + scale[-1]) / 2.0 if scale else 0.0
    sides = [[one for one in scale if (one > middle) is upper] for upper in (False, True)]
    found: drawing.Behind = {}
    rows = []
    with drawing.house_style():
        figure, axes = _canvas(dataset, lines)
        for at, line in enumerate(lines):
            above = round((line.summary.positive or 0.0) * line.summary.answers / 100.0)
            parts = shares((line.summary.answers - above, above))
            n = count(line.summary.respondents, behind(line.statements, responses))
            rows.append((label_of(line), n, *(number(part, 1) for part in parts or (None, None))))
            for side, values in enumerate(sides if parts else ()):
                gid = _half(axes, at, line, parts or (), side)
                found[gid] = behind(line.statements, responses, values)
        if lines:
            axes.set_xlim(0.0, 100.0)
            axes.set_xlabel("% of the answers")
            named = zip(LOOKS, ("non-positive", "positive"), strict=True)
            handles = [Patch(**look, label=label) for look, label in named]
            figure.legend(handles=handles, loc="outside lower center", ncols=2, handlelength=1.0)
    title = "Final questionnaire: balance between non-positive and positive responses."
    head = ("", "n", "non-positive (%)", "positive (%)")
    notes = (note(dataset, responses), ROUNDED)
    return drawing.Drawing(figure, Table.of("figure-8b", title, head, rows, notes), found)


def _half(axes: Axes, at: int, line: LikertRow, parts: Sequence[float], side: int) -> str:
    key = f"{('nonpositive', 'positive')[side]}-{line.kind}-{line.key}"
    left, share = (0.0, parts[0])[side], parts[side]
    axes.barh(at, share, BAR, left=left, **LOOKS[side])[0].set_gid(key)
    if share >= LEAST_LABELLED:
        box = None if side else {"boxstyle": "round,pad=0.15", "fc": drawing.NEGATIVE, "ec": "none"}
        look = drawing.Look(ha="center", va="center", fontsize=7, bbox=box)
        colour = (drawing.INK, "white")[side]
        axes.text(left + share / 2.0, at, f"{share:.0f}", color=colour, **look)
    return key


def _label(dataset: Dataset, line: LikertRow) -> str:
    """Return the label of a row at the axis: a statement by its text, with its key in Table 4."""
    if line.kind != "statement":
        return fill(label_of(line), LABEL)
    definition = dataset.questionnaire(dataset.study.statements)
    question = definition.question(line.key) if definition else None
    text = dataset.say(question.text) if question else ""
    return fill(f"{text} ({label_of(line)})", LABEL) if text else label_of(line)


def _canvas(
    dataset: Dataset, lines: Sequence[LikertRow], least: float = ROW
) -> tuple[Figure, Axes]:
    labels = [_label(dataset, line) for line in lines]
    row = max(least, 0.06 + LINE * max((label.count("\n") + 1 for label in labels), default=1))
    figure, (axes,) = drawing.panels(1, 1, 1.1 + row * max(3, len(lines)))
    if not lines:
        axes.axis("off")
        look = drawing.Look(ha="center", va="center", transform=axes.transAxes)
        axes.text(0.5, 0.5, "There is no questionnaire of statements.", **look)
        return figure, axes
    axes.set_yticks(range(len(lines)), labels, fontsize=7)
    axes.set_ylim(len(lines) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    for label, line in zip(axes.get_yticklabels(), lines, strict=True):
        label.set_fontweight("bold" if line.kind == "overall" else "normal")
    for at, (line, following) in enumerate(pairwise(lines)):
        if line.kind != following.kind:
            axes.axhline(at + 0.5, color=drawing.FAINT, linewidth=0.6)
    return figure, axes
