"""The style of all figures, and their files: the same numbers give the same bytes on any machine.

That needs three things: no date and no program in the files, ids in SVG from a fixed salt, and the
font that comes with matplotlib. A part that has sessions behind it has a `gid`, which an SVG keeps
as its `id`, so that a page can open these sessions.
"""

import io
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from math import ceil
from pathlib import Path
from typing import Any

from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.analysis.tables.people import label_kinds, title_of
from experiments.analysis.tables.table import Table
from experiments.dataset.records import ParticipantRecord

WIDTH = 7.0  # inches: a page's two columns
# Six of the eight colours of Okabe and Ito (2008), for colour-blind readers, in the order in which
# neighbours differ most in lightness, with a marker and a line each, for prints without colours.
ROBOTS = ("#D55E00", "#56B4E9", "#000000", "#E69F00", "#0072B2", "#CC79A7")
MARKERS = ("D", "o", "s", "^", "v", "P")
DASHES = ("-", "--", ":", "-.", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 4)))
NEGATIVE, POSITIVE = "#E69F00", "#0072B2"
SMALL = 7.0  # points
PRINT_DPI = 600  # what journals ask for of drawings in dots
INK, WALL, FLOOR, FAINT = "#222222", "#4d4d4d", "#f7f5f0", "#b9b9b9"
Look = dict[str, Any]  # how something is drawn, by matplotlib's keywords
Behind = dict[str, tuple[str, ...]]  # the sessions behind each part, by gid
_FONT = b"font-family: 'DejaVu Sans'"
_STYLE = Path(__file__).with_name("house.mplstyle")


@dataclass(frozen=True)
class Drawing:
    """A figure, the table of its numbers, and the sessions behind each `gid`."""

    figure: Figure
    numbers: Table
    behind: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.numbers.name

    @property
    def title(self) -> str:
        return self.numbers.title


# matplotlib's settings are global, and pages draw in threads
_ONE_AT_A_TIME = threading.RLock()


@contextmanager
def house_style() -> Iterator[None]:
    """Draw and save in the style of all figures, whatever the machine's own settings are."""
    with _ONE_AT_A_TIME, style.context(["default", _STYLE]):
        yield


def label_figure(drawing: Drawing, people: Sequence[ParticipantRecord]) -> Drawing:
    """Return a figure that names its kinds of participants, unless they are participants alone."""
    if title := title_of(people):
        with house_style():
            drawing.figure.suptitle(title, fontsize=SMALL, fontweight="bold")
    return replace(drawing, numbers=label_kinds(drawing.numbers, people))


def as_svg(drawing: Drawing) -> bytes:
    svg = _saved(drawing, "svg", {"Date": None, "Creator": None, "Title": drawing.title})
    return svg.replace(_FONT, _FONT + b", Verdana, sans-serif")


def as_pdf(drawing: Drawing) -> bytes:
    about = {"CreationDate": None, "Creator": None, "Producer": None, "Title": drawing.title}
    return _saved(drawing, "pdf", about)


def as_png(drawing: Drawing, dpi: int = PRINT_DPI) -> bytes:
    return _saved(drawing, "png", {"Software": None, "Title": drawing.title}, dpi)


def panels(count: int, columns: int, height: float) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axes = figure.subplots(ceil(count / columns), columns, squeeze=False).ravel().tolist()
    for empty in axes[count:]:
        empty.set_axis_off()
    return figure, axes[:count]


def _saved(
    drawing: Drawing, kind: str, metadata: dict[str, str | None], dpi: int | str = "figure"
) -> bytes:
    buffer = io.BytesIO()
    with house_style():
        drawing.figure.savefig(buffer, format=kind, metadata=metadata, dpi=dpi)
    return buffer.getvalue()
