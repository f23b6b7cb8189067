"""A floor plan as the ground of a figure: walls, doors, docks, checkpoints."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon, Rectangle

from experiments.analysis.figures.drawing import FAINT, FLOOR, INK, WALL, Look
from experiments.dataset.columns import Floats
from experiments.definition.schema import StudyCheckpoint
from robots.api.floorplan import ChargingDock, Door, FloorPlan, Furniture
from robots.world.solids import bar

BELOW = 0.1  # share of the width that is added below, for the scale bar
BARS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # lengths of a scale bar, in metres
MARGIN, AROUND = 0.35, 1.0  # m: around a plan, and around the ways in a part of it
LONGEST_STEP = 1.0  # m: a line is not drawn between places that are farther apart


def draw_plan(
    axes: Axes, plan: FloorPlan, *, furniture: bool = True, view: Floats | None = None
) -> None:
    """Draw a plan in metres, or the view of it between two corners, (2, 2), without ticks."""
    for room in plan.rooms:
        _fill(axes, room.polygon, facecolor=FLOOR, edgecolor="none", zorder=0)
    for opening in plan.openings:
        outline = bar(opening.start, opening.end, opening.thickness)
        _fill(axes, outline, facecolor=FLOOR, edgecolor="none", zorder=0)
    for piece in plan.furniture if furniture else ():
        look = Look(facecolor="#e6e2d8", edgecolor=FAINT, linewidth=0.4, zorder=1)
        _fill(axes, _outline(piece), **look)
    for wall in plan.walls:
        outline = bar(wall.start, wall.end, wall.thickness)
        _fill(axes, outline, facecolor=WALL, edgecolor=WALL, linewidth=0.4, zorder=3)
    for door in plan.doors:
        _door(axes, door)
    for mirror in plan.mirrors:
        (x, y), (u, v) = mirror.start, mirror.end
        look = Look(color=FAINT, linewidth=2.5, solid_capstyle="butt", zorder=4)
        axes.plot([x, u], [y, v], **look)
    low, high = (whole_of(plan) if view is None else view).tolist()
    width = high[0] - low[0]
    below = BELOW * width
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1] - below, high[1])
    axes.set_aspect("equal")
    axes.axis("off")
    beneath = Rectangle((low[0], low[1] - below), width, below, color="white", zorder=7)
    axes.add_patch(beneath)
    _scale_bar(axes, (low[0] + 0.04 * width, low[1] - 0.25 * below), width)


def _fill(axes: Axes, outline: Any, **look: Any) -> None:
    axes.add_patch(Polygon(outline, closed=True, **look))


def whole_of(plan: FloorPlan) -> Floats:
    """Return the lower left and the upper right corner of a plan, (2, 2), with a margin."""
    corners = np.array([point for room in plan.rooms for point in room.polygon])
    return np.array((corners.min(axis=0) - MARGIN, corners.max(axis=0) + MARGIN))


def view_of(plan: FloorPlan, ways: Sequence[Floats]) -> Floats:
    """Return the corners, (2, 2), of the part of a plan that has paths; all of it without any."""
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


def _outline(piece: Furniture) -> Floats:
    turns = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
    outline = np.column_stack((np.cos(turns), np.sin(turns))) * piece.width / 2.0
    if piece.shape != "cylinder":
        corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
        outline = corners * (piece.width / 2.0, piece.depth / 2.0)
    cosine, sine = math.cos(piece.theta), math.sin(piece.theta)
    turned: Floats = outline @ np.array([[cosine, sine], [-sine, cosine]]) + (piece.x, piece.y)
    return turned


def _door(axes: Axes, door: Door) -> None:
    """An open leaf and the quarter circle that it sweeps, as architects draw it."""
    (x, y), (u, v) = door.start, door.end
    width, closed = math.hypot(u - x, v - y), math.atan2(v - y, u - x)
    sweep = closed + np.linspace(0.0, door.swing, 20)
    xs, ys = x + width * np.cos(sweep), y + width * np.sin(sweep)
    axes.plot(xs, ys, color=FAINT, linewidth=0.5, zorder=2)
    leaf = (x + width * math.cos(sweep[-1]), y + width * math.sin(sweep[-1]))
    axes.plot([x, leaf[0]], [y, leaf[1]], color=WALL, linewidth=1.0, zorder=2)


def draw_dock(axes: Axes, dock: ChargingDock, label: str, colour: str) -> None:
    station, cosine, sine = dock.station, math.cos(dock.theta), math.sin(dock.theta)
    x, y = dock.x + station.distance * cosine, dock.y + station.distance * sine
    corner, turn = (x, y - station.width / 2.0), math.degrees(dock.theta)
    look = Look(angle=turn, rotation_point=(x, y), facecolor=colour, zorder=4)
    axes.add_patch(Rectangle(corner, station.depth, station.width, **look))
    back = 0.45
    where = (dock.x - back * cosine, dock.y - back * sine - 0.45)
    box = Look(boxstyle="square,pad=0.15", facecolor="white", edgecolor="none", alpha=0.75)
    look = Look(fontsize=7, color=colour, fontweight="bold", zorder=7, bbox=box)
    axes.annotate(label, where, ha="center", va="center", **look)


def draw_checkpoint(axes: Axes, stop: StudyCheckpoint, colour: str) -> None:
    disc = Look(markerfacecolor="white", markeredgecolor=colour, markeredgewidth=1.1)
    axes.plot([stop.x], [stop.y], marker="o", markersize=9, zorder=6, **disc)
    look = Look(ha="center", va="center_baseline", fontsize=6.5, color=INK, zorder=7)
    axes.annotate(str(stop.number), (stop.x, stop.y), **look)


def thinned(way: Floats, tolerance: float = 0.02) -> Floats:
    """Return points of a path, (n, 2), from whose line no other is farther than the tolerance in
    metres (Ramer, 1972; Douglas and Peucker, 1973), with a row of NaN in jumps above LONGEST_STEP.
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
    along = end - start
    squared = float(along @ along) or 1.0  # both ends may be the same place
    share = np.clip((points - start) @ along / squared, 0.0, 1.0)
    return np.asarray(np.hypot(*(points - start - share[:, None] * along).T))
