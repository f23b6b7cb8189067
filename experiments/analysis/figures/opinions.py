"""Figure 8 of the paper: the final questionnaire as bars. (a) the length is the mean, the colours
are shares; (b) all are 100 %.
"""

from collections.abc import Sequence
from textwrap import fill
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from experiments.analysis.dataset.records import Dataset, ResponseRecord
from experiments.analysis.figures.drawing import (
    FAINT,
    HATCH,
    INK,
    NEGATIVE,
    POSITIVE,
    WIDTH,
    Drawing,
    colours_of,
    house_style,
)
from experiments.analysis.statistics.descriptive import ROUNDED, shares
from experiments.analysis.tables.paper_tables import (
    behind,
    label_of,
    lines_of,
    said,
    scale_of,
    signed,
)
from experiments.analysis.tables.response_selection import note
from experiments.analysis.tables.table import Table, TableCell, count, number, words
from surveys.likert import LikertRow

BAR = 0.72
ROW = 0.27  # inches
LEAST_LABELLED = 6.0  # per cent, below which no number fits into a bar
LABEL = 52  # characters of a line beside the bars
LINE = 0.115  # inches
Behind = dict[str, tuple[str, ...]]


def figure_8a(dataset: Dataset) -> Drawing:
    """Return a bar a row of Table 5, as long as its mean, coloured by the shares of the scale's
    values.
    """
    lines, responses = lines_of(dataset)
    scale = scale_of(dataset)
    title = (
        "Final questionnaire: bar lengths are the mean value, stacked colours the rate of answers"
        " per scale value."
    )
    found: Behind = {}
    with house_style():
        figure, axes = _canvas(dataset, lines)
        for at, line in enumerate(lines):
            found |= _stack(axes, at, line, responses, scale)
        if lines:
            low = min(0.0, *(line.summary.mean or 0.0 for line in lines))
            axes.set_xlim(float(scale[0]) if low < 0.0 else 0.0, float(scale[-1]))
            axes.set_xticks(
                [value for value in scale if value >= 0 or low < 0.0],
                [signed(v) for v in scale if v >= 0 or low < 0.0],
            )
            axes.axvline(0.0, color=INK, linewidth=0.6)
            axes.set_xlabel(
                f"mean of participants' answers ({signed(scale[0])} to {signed(scale[-1])})"
            )
            handles = [
                Patch(**_look(value, colour), label=_legend(dataset, value))
                for value, colour in zip(scale, colours_of(len(scale)), strict=True)
            ]
            figure.legend(
                handles=handles, loc="outside lower center", ncols=len(scale), handlelength=1.0
            )
    rows = tuple(_numbers(line, responses, scale) for line in lines)
    head = ("", "n", "mean", *(f"% {signed(value)}" for value in scale))
    return Drawing(
        "figure-8a",
        title,
        figure,
        Table("figure-8a", title, head, rows, (note(dataset, responses), ROUNDED)),
        found,
    )


def figure_8b(dataset: Dataset) -> Drawing:
    """Return a bar of 100 % a row of Table 5: non-positive against positive answers."""
    lines, responses = lines_of(dataset)
    scale = scale_of(dataset)
    title = "Final questionnaire: balance between non-positive and positive responses."
    found: Behind = {}
    rows: list[tuple[TableCell, ...]] = []
    with house_style():
        figure, axes = _canvas(dataset, lines)
        for at, line in enumerate(lines):
            parts = _balance(line)
            groups = (
                [value for value in scale if value <= 0],
                [value for value in scale if value > 0],
            )
            printed = (number(part, 1) for part in parts or (None, None))
            rows.append(
                (
                    words(label_of(line)),
                    count(line.summary.respondents, behind(line, responses)),
                    *printed,
                )
            )
            for side, values in enumerate(groups):
                if parts:
                    found[_half(axes, at, line, parts, side)] = said(line, responses, values)
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


def _canvas(dataset: Dataset, lines: Sequence[LikertRow]) -> tuple[Figure, Axes]:
    labels = [_label(dataset, line) for line in lines]
    row = max(ROW, 0.06 + LINE * max((label.count("\n") + 1 for label in labels), default=1))
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


def _stack(
    axes: Axes, at: int, line: LikertRow, responses: Sequence[ResponseRecord], scale: Sequence[int]
) -> Behind:
    mean, parts = line.summary.mean, line.summary.percentages
    if mean is None or parts is None:
        axes.text(0.02, at, "no answers", va="center", fontsize=7, color=INK)
        return {}
    found: Behind = {}
    left = 0.0
    for value, part, colour in zip(scale, parts, colours_of(len(scale)), strict=True):
        key = f"value{value}-{line.kind}-{line.key}"
        axes.barh(at, mean * part / 100.0, BAR, left=left, **_look(value, colour))[0].set_gid(key)
        found[key] = said(line, responses, (value,))
        left += mean * part / 100.0
    side = 1 if mean >= 0.0 else -1
    _beside(axes, f"{mean:.2f}".replace("-", "−"), (mean, at), side)
    return found


def _beside(axes: Axes, text: str, where: tuple[float, float], side: int) -> None:
    """Write a number beyond the end of a bar: side 1 is right of it, -1 left."""
    axes.annotate(
        text,
        where,
        (4 * side, 0),
        textcoords="offset points",
        va="center",
        ha="left" if side > 0 else "right",
        fontsize=7,
    )


def _balance(line: LikertRow) -> tuple[float, ...] | None:
    """Non-positive and positive answers, in percent."""
    total = line.summary.answers
    above = round((line.summary.positive or 0.0) * total / 100.0)
    return shares((total - above, above))


def _numbers(
    line: LikertRow, responses: Sequence[ResponseRecord], scale: Sequence[int]
) -> tuple[TableCell, ...]:
    about = behind(line, responses)
    parts = shares(line.summary.counts) or (None,) * len(scale)
    return (
        words(label_of(line)),
        count(line.summary.respondents, about),
        number(line.summary.mean, 2, about),
        *(number(part, 1, about) for part in parts),
    )


def _legend(dataset: Dataset, value: int) -> str:
    definition = dataset.questionnaire(dataset.study.analysis.statements)
    points = (
        next((one.points for one in definition.questions() if one.points), ()) if definition else ()
    )
    label = next((dataset.say(point.label) for point in points if point.value == value), "")
    return f"{signed(value)} {label}".strip()
