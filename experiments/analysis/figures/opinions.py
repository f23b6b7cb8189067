"""Figure 8 of the paper: the final questionnaire. (a) means with intervals, and the shares of the
answers (the paper's bars are as long as the mean and divided by the shares, which nobody can read
where it is near 0); (b) bars of 100 %.
"""

import math
from collections.abc import Sequence
from textwrap import fill
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from experiments.analysis.figures.drawing import (
    FAINT,
    HATCH,
    INK,
    NEGATIVE,
    POSITIVE,
    WIDTH,
    Drawing,
    house_style,
)
from experiments.analysis.statistics.descriptive import ROUNDED, shares
from experiments.analysis.tables.paper_tables import (
    INTERVALS,
    answering,
    behind,
    counted_in,
    label_of,
    lines_of,
    scale_of,
    signed,
)
from experiments.analysis.tables.response_selection import note
from experiments.analysis.tables.table import Table, TableCell, count, number, words
from experiments.dataset.records import Dataset, ResponseRecord
from surveys.likert import LikertRow

BAR = 0.72
ROW, ROW_OF_MEANS = 0.27, 0.36  # inches
BELOW, ABOVE = 0.14, 0.3  # of a row, from its middle to the discs and to the mean
WHOLE = 330.0  # square points: the disc of all answers
DISC: dict[str, Any] = {"facecolor": "#c9dcec", "edgecolor": "#54697c", "linewidths": 0.5}
POINT: dict[str, Any] = {"marker": "D", "markersize": 3.4, "color": INK, "linestyle": "none"}
INTERVAL: dict[str, Any] = {"ecolor": INK, "elinewidth": 1.1, "capsize": 2.2, "fmt": "none"}
LEAST_LABELLED = 6.0  # per cent, below which no number fits into a bar
LABEL = 52  # characters of a line beside the bars
LINE = 0.115  # inches
Behind = dict[str, tuple[str, ...]]


def figure_8a(dataset: Dataset) -> Drawing:
    """Return a row a row of Table 5: its mean with the interval, and below a disc at each value of
    the scale, whose area is the share of the answers.
    """
    lines, responses = lines_of(dataset)
    labels = scale_of(dataset)
    scale = tuple(labels)
    title = (
        "Final questionnaire: means with their 95 % confidence intervals, and below them the share"
        " of the answers at each value of the scale."
    )
    found: Behind = {}
    with house_style():
        figure, axes = _canvas(dataset, lines, ROW_OF_MEANS)
        for at, line in enumerate(lines):
            found |= _mean_and_shares(axes, at, line, responses, scale)
        if lines:
            margin = 0.12 * (scale[-1] - scale[0])
            axes.set_xlim(scale[0] - margin, scale[-1] + margin)
            axes.set_xticks(
                scale,
                [fill(f"{signed(value)} {label}".strip(), 12) for value, label in labels.items()],
            )
            axes.grid(axis="x", color=FAINT, linewidth=0.4)
            axes.set_axisbelow(True)
            figure.legend(handles=_keys(), loc="outside lower center", ncols=3, handletextpad=0.8)
    rows = tuple(_numbers(line, responses, scale) for line in lines)
    head = ("", "n", "mean", "CI95", *(f"% {signed(value)}" for value in scale))
    notes = (
        note(dataset, responses),
        *counted_in(responses),
        INTERVALS[dataset.study.analysis.interval],
        ROUNDED,
    )
    return Drawing("figure-8a", title, figure, Table("figure-8a", title, head, rows, notes), found)


def _mean_and_shares(
    axes: Axes, at: int, line: LikertRow, responses: Sequence[ResponseRecord], scale: Sequence[int]
) -> Behind:
    mean, half, parts = line.summary.mean, line.summary.ci95, line.summary.percentages
    if mean is None or parts is None:
        axes.text(scale[0], at, "no answers", va="center", fontsize=7, color=INK)
        return {}
    found: Behind = {}
    for value, part in zip(scale, parts, strict=True):
        if part > 0.0:
            key = f"value{value}-{line.kind}-{line.key}"
            axes.scatter((value,), (at + BELOW,), s=WHOLE * part / 100.0, **DISC, gid=key)
            found[key] = answering(line, responses, (value,))
    key = f"mean-{line.kind}-{line.key}"
    axes.plot((mean,), (at - ABOVE,), **POINT, gid=key)
    found[key] = behind(line.statements, responses)
    told = f"{mean:.2f}".replace("-", "−")
    if half is not None:
        axes.errorbar((mean,), (at - ABOVE,), xerr=(half,), **INTERVAL)
        told += f" ± {half:.2f}"
    where = axes.get_yaxis_transform()
    axes.text(1.01, at - ABOVE, told, transform=where, va="center", fontsize=7)
    return found


def _keys() -> list[Line2D]:
    """The legend: a mean with its interval, and discs of two shares."""
    discs = [
        Line2D(
            [],
            [],
            linestyle="none",
            marker="o",
            markersize=math.sqrt(WHOLE * part / 100.0),
            markerfacecolor=DISC["facecolor"],
            markeredgecolor=DISC["edgecolor"],
            markeredgewidth=DISC["linewidths"],
            label=f"{part} % of the answers",
        )
        for part in (10, 50)
    ]
    return [Line2D([], [], **{**POINT, "linestyle": "-"}, label="mean and 95 % CI"), *discs]


def figure_8b(dataset: Dataset) -> Drawing:
    """Return a bar of 100 % a row of Table 5: non-positive against positive answers."""
    lines, responses = lines_of(dataset)
    scale = tuple(scale_of(dataset))
    middle = (scale[0] + scale[-1]) / 2.0 if scale else 0.0
    title = "Final questionnaire: balance between non-positive and positive responses."
    found: Behind = {}
    rows: list[tuple[TableCell, ...]] = []
    with house_style():
        figure, axes = _canvas(dataset, lines)
        for at, line in enumerate(lines):
            parts = _balance(line)
            groups = (
                [value for value in scale if value <= middle],
                [value for value in scale if value > middle],
            )
            printed = (number(part, 1) for part in parts or (None, None))
            rows.append(
                (
                    words(label_of(line)),
                    count(line.summary.respondents, behind(line.statements, responses)),
                    *printed,
                )
            )
            for side, values in enumerate(groups):
                if parts:
                    found[_half(axes, at, line, parts, side)] = answering(line, responses, values)
        if lines:
            axes.set_xlim(0.0, 100.0)
            axes.set_xlabel("% of the answers")
            handles = [
                Patch(**_look(-1, NEGATIVE), label="non-positive"),
                Patch(**_look(1, POSITIVE), label="positive"),
            ]
            figure.legend(handles=handles, loc="outside lower center", ncols=2, handlelength=1.0)
    head = ("", "n", "non-positive (%)", "positive (%)")
    return Drawing(
        "figure-8b",
        title,
        figure,
        Table("figure-8b", title, head, tuple(rows), (note(dataset, responses), ROUNDED)),
        found,
    )


def _half(axes: Axes, at: int, line: LikertRow, parts: Sequence[float], side: int) -> str:
    """Draw one side of a balance, and return its gid."""
    key = f"{('nonpositive', 'positive')[side]}-{line.kind}-{line.key}"
    left, share = (0.0, parts[0])[side], parts[side]
    look = (_look(-1, NEGATIVE), _look(1, POSITIVE))[side]
    axes.barh(at, share, BAR, left=left, **look)[0].set_gid(key)
    if share >= LEAST_LABELLED:
        axes.text(
            left + share / 2.0,
            at,
            f"{share:.0f}",
            ha="center",
            va="center",
            fontsize=7,
            color=(INK, "white")[side],
            bbox=None if side else {"boxstyle": "round,pad=0.15", "fc": NEGATIVE, "ec": "none"},
        )
    return key


def _look(value: int, colour: str) -> dict[str, Any]:
    """Return how a part of a bar looks: what is below the middle is hatched, for grey prints."""
    hatch = HATCH if value < 0 else ""
    return {"facecolor": colour, "edgecolor": INK, "linewidth": 0.3, "hatch": hatch}


def _label(dataset: Dataset, line: LikertRow) -> str:
    """Return what a row is called at the axis: a statement by its text, with its key in Table 4."""
    if line.kind != "statement":
        return fill(label_of(line), LABEL)
    definition = dataset.questionnaire(dataset.study.analysis.statements)
    question = definition.question(line.key) if definition else None
    text = dataset.say(question.text) if question else ""
    return fill(f"{text} ({label_of(line)})", LABEL) if text else label_of(line)


def _canvas(
    dataset: Dataset, lines: Sequence[LikertRow], least: float = ROW
) -> tuple[Figure, Axes]:
    labels = [_label(dataset, line) for line in lines]
    row = max(least, 0.06 + LINE * max((label.count("\n") + 1 for label in labels), default=1))
    figure = Figure(figsize=(WIDTH, 1.1 + row * max(3, len(lines))), layout="constrained")
    axes: Axes = figure.subplots()
    if not lines:
        axes.axis("off")
        axes.text(
            0.5,
            0.5,
            "There is no questionnaire of statements.",
            ha="center",
            va="center",
            transform=axes.transAxes,
        )
        return figure, axes
    axes.set_yticks(range(len(lines)), labels, fontsize=7)
    axes.set_ylim(len(lines) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    for label, line in zip(axes.get_yticklabels(), lines, strict=True):
        label.set_fontweight("bold" if line.kind == "overall" else "normal")
    for before, after in zip(range(len(lines)), range(1, len(lines)), strict=False):
        if lines[before].kind != lines[after].kind:
            axes.axhline((before + after) / 2.0, color=FAINT, linewidth=0.6)
    return figure, axes


def _balance(line: LikertRow) -> tuple[float, ...] | None:
    """Non-positive and positive answers, in percent."""
    total = line.summary.answers
    above = round((line.summary.positive or 0.0) * total / 100.0)
    return shares((total - above, above))


def _numbers(
    line: LikertRow, responses: Sequence[ResponseRecord], scale: Sequence[int]
) -> tuple[TableCell, ...]:
    about = behind(line.statements, responses)
    parts = shares(line.summary.counts) or (None,) * len(scale)
    return (
        words(label_of(line)),
        count(line.summary.respondents, about),
        number(line.summary.mean, 2, about),
        number(line.summary.ci95, 2, about),
        *(number(part, 1, about) for part in parts),
    )
