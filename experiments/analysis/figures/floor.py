"""A floor plan as the ground of a figure: walls, doors, docks, checkpoints."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon, Rectangle

from experiments.analysis.figures.drawing import FAINT, FLOOR, INK, WALL
from experiments.dataset.columns import Floats
from experiments.definition.schema import StudyCheckpoint
from robots.api.floorplan import ChargingDock, Door, FloorPlan, Mirror
from robots.world.solids import bar

BELOW = 0.1  # of the width of what is shown: the room below it, for the scale bar
BARS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # lengths of a scale bar, in metres
MARGIN, AROUND = 0.35, 1.0  # m: around a plan, and around the ways in a part of it
LONGEST_STEP = 1.0  # m: a line is not drawn between places that are farther apart


def draw_plan(
    axes: Axes, plan: FloorPlan, *, furniture: bool = True, view: Floats | None = None
) -> None:
    """Draw a plan in metres, as seen from above, without ticks: all of it, or a view, (2, 2), the
    lower left and the upper right corner.
    """
    for room in plan.rooms:
        axes.add_patch(
            Polygon(room.polygon, closed=True, facecolor=FLOOR, edgecolor="none", zorder=0)
        )
    for opening in plan.openings:
        axes.add_patch(
            Polygon(
                bar(opening.start, opening.end, opening.thickness),
                closed=True,
                facecolor=FLOOR,
                edgecolor="none",
                zorder=0,
            )
        )
    for piece in plan.furniture if furniture else ():
        axes.add_patch(
            _thing(
                piece.x,
                piece.y,
                piece.theta,
                piece.width,
                piece.depth,
                cylinder=piece.shape == "cylinder",
            )
        )
    for wall in plan.walls:
        axes.add_patch(
            Polygon(
                bar(wall.start, wall.end, wall.thickness),
                closed=True,
                facecolor=WALL,
                edgecolor=WALL,
                linewidth=0.4,
                zorder=3,
            )
        )
    for door in plan.doors:
        _door(axes, door)
    for mirror in plan.mirrors:
        _mirror(axes, mirror)
    low, high = whole_of(plan) if view is None else view
    axes.set_xlim(low[0], high[0])
    width = float(high[0] - low[0])
    below = BELOW * width
    axes.set_ylim(low[1] - below, high[1])
    axes.set_aspect("equal")
    axes.axis("off")
    beneath = Rectangle((low[0], low[1] - below), width, below, color="white", zorder=7)
    axes.add_patch(beneath)
    _scale_bar(axes, (float(low[0]) + 0.04 * width, float(low[1]) - 0.25 * below), width)


def whole_of(plan: FloorPlan) -> Floats:
    """Return the corners, (2, 2), between which a plan lies, with a margin."""
    corners = np.array([point for room in plan.rooms for point in room.polygon])
    return np.array((corners.min(axis=0) - MARGIN, corners.max(axis=0) + MARGIN))


def view_of(plan: FloorPlan, ways: Sequence[Floats]) -> Floats:
    """Return the corners, (2, 2), of the part of a plan in which there are ways, with AROUND beside
    them; all of it without ways.
    """
    whole = whole_of(plan)
    points = np.vstack((np.empty((0, 2)), *ways))
    if not len(points):
        return whole
    low, high = np.nanmin(points, axis=0) - AROUND, np.nanmax(points, axis=0) + AROUND
    return np.array((np.maximum(low, whole[0]), np.minimum(high, whole[1])))


def _scale_bar(axes: Axes, start: tuple[float, float], width: float) -> None:
    """Draw the longest bar of a round length that is no longer than a fifth of the map."""
    length = max((one for one in BARS if one <= width / 5.0), default=BARS[0])
    x, y = start
    tick = 0.01 * width
    for at in (x, x + length):
        axes.plot([at, at], [y - tick, y + tick], color=INK, linewidth=0.9, zorder=8)
    axes.plot([x, x + length], [y, y], color=INK, linewidth=0.9, zorder=8, gid="scale-bar")
    middle = (x + length / 2.0, y - 1.5 * tick)
    axes.annotate(f"{length:g} m", middle, ha="center", va="top", fontsize=7, zorder=8)


def _thing(
    x: float, y: float, theta: float, width: float, depth: float, *, cylinder: bool
) -> Polygon:
    turns = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
    outline = np.column_stack((np.cos(turns), np.sin(turns))) * width / 2.0
    if not cylinder:
        outline = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (width / 2.0, depth / 2.0)
    cosine, sine = math.cos(theta), math.sin(theta)
    return Polygon(
        outline @ np.array([[cosine, sine], [-sine, cosine]]) + (x, y),
        closed=True,
        facecolor="#e6e2d8",
        edgecolor=FAINT,
        linewidth=0.4,
        zorder=1,
    )


def _door(axes: Axes, door: Door) -> None:
    """An open leaf and the quarter circle that it sweeps, as architects draw it."""
    (x, y), (u, v) = door.start, door.end
    width, closed = math.hypot(u - x, v - y), math.atan2(v - y, u - x)
    sweep = closed + np.linspace(0.0, door.swing, 20)
    axes.plot(
        x + width * np.cos(sweep), y + width * np.sin(sweep), color=FAINT, linewidth=0.5, zorder=2
    )
    axes.plot(
        [x, x + width * math.cos(sweep[-1])],
        [y, y + width * math.sin(sweep[-1])],
        color=WALL,
        linewidth=1.0,
        zorder=2,
    )


def _mirror(axes: Axes, mirror: Mirror) -> None:
    (x, y), (u, v) = mirror.start, mirror.end
    axes.plot([x, u], [y, v], color=FAINT, linewidth=2.5, solid_capstyle="butt", zorder=4)


def draw_dock(axes: Axes, dock: ChargingDock, label: str, colour: str) -> None:
    """Draw a charging station and its robot's name beside it."""
    station = dock.station
    x, y = (
        dock.x + station.distance * math.cos(dock.theta),
        dock.y + station.distance * math.sin(dock.theta),
    )
    turned = math.degrees(dock.theta)
    box = Rectangle(
        (x, y - station.width / 2.0),
        station.depth,
        station.width,
        angle=turned,
        rotation_point=(x, y),
        facecolor=colour,
        zorder=4,
    )
    axes.add_patch(box)
    back = 0.45
    where = (dock.x - back * math.cos(dock.theta), dock.y - back * math.sin(dock.theta) - 0.45)
    box_style = {
        "boxstyle": "square,pad=0.15",
        "facecolor": "white",
        "edgecolor": "none",
        "alpha": 0.75,
    }
    axes.annotate(
        label,
        where,
        ha="center",
        va="center",
        fontsize=7,
        color=colour,
        fontweight="bold",
        zorder=7,
        bbox=box_style,
    )


def draw_checkpoint(
    axes: Axes, stop: StudyCheckpoint, colour: str, *, shift: tuple[float, float] = (0.0, 0.0)
) -> None:
    """Draw a checkpoint as a disc with its number."""
    x, y = stop.x + shift[0], stop.y + shift[1]
    axes.plot(
        [x],
        [y],
        marker="o",
        markersize=9,
        markerfacecolor="white",
        markeredgecolor=colour,
        markeredgewidth=1.1,
        zorder=6,
    )
    axes.annotate(
        str(stop.number),
        (x, y),
        ha="center",
        va="center_baseline",
        fontsize=6.5,
        color=INK,
        zorder=7,
    )


def thinned(way: Floats, tolerance: float = 0.02) -> Floats:
    """Return points of a way, (n, 2), from whose line no other is farther than the tolerance in
    metres (Ramer, 1972; Douglas and Peucker, 1973).

    Where a way jumps by more than LONGEST_STEP, both ends are kept with a row of NaN between them.
    """
    if len(way) < 3:
        return way
    jumps = np.flatnonzero(np.hypot(*np.diff(way, axis=0).T) > LONGEST_STEP)
    ends = np.unique([0, *jumps.tolist(), *(jumps + 1).tolist(), len(way) - 1]).tolist()
    keep = np.zeros(len(way), dtype=np.bool_)
    keep[ends] = True
    open_parts = list(pairwise(ends))
    while open_parts:
        first, last = open_parts.pop()
        if last - first < 2:
            continue
        away = _off_the_line(way[first + 1 : last], way[first], way[last])
        worst = int(away.argmax())
        if away[worst] > tolerance:
            middle = first + 1 + worst
            keep[middle] = True
            open_parts += [(first, middle), (middle, last)]
    behind = np.searchsorted(np.flatnonzero(keep), jumps, side="right")
    return np.insert(way[keep], behind, np.nan, axis=0)


def _off_the_line(points: Floats, start: Floats, end: Floats) -> Floats:
    """Distances of points, (n, 2), from the straight piece between two."""
    along = end - start
    length = float(along @ along)
    share = (
        np.clip((points - start) @ along / length, 0.0, 1.0) if length else np.zeros(len(points))
    )
    off = points - start - share[:, None] * along
    return np.hypot(off[:, 0], off[:, 1])
