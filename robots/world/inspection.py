"""Whether robots can drive in a site: plan and map must show the same place, and robots must be
able to reach the places of the plan.

The checks of `robots.api.floorplan` need only the plan and run first; these also need the map. The
result is one sentence for each error.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy

from robots.api.floorplan import ChargingDock, Door, FloorPlan, Passage
from robots.api.geometry import Pose2D
from robots.world.grid import OccupancyGrid
from robots.world.render_plan import RESOLUTION, rasterise
from robots.world.sensing import points_in_frame

# metres from the centre of the widest robot to its side: the clearance that a route needs
HALF_WIDTH = 0.28
BACKED_OUT = 0.6  # metres behind the docked pose, where docking begins
# least share of the plan's walls that the map must show; one made by a robot misses some
WALLS_SHOWN = 0.65
WALL_TOLERANCE = 0.15  # metres between a wall of the plan and the same on the map
FLOOR_SHOWN = 0.75  # least share of the rooms' floor that must be free on the map, furniture aside
MOST_CELLS = 200_000  # of a drawing; that of a very large plan is coarser
# of which none may fit much better than the one that the map says
OTHER_SCALES = (0.5, 0.8, 0.9, 1.1, 1.25, 2.0)
MUCH_BETTER = 0.15
MOST_SAMPLES = 5000
SAMPLE = 0.1  # metres between the points that are checked

Floats = npt.NDArray[np.float64]
Spots = list[tuple[str, float, float]]


def inspect_site(plan: FloorPlan, grid: OccupancyGrid) -> tuple[str, ...]:
    """Return a sentence for each error of a well-formed plan and its map; empty without any."""
    if not grid.free().any():
        return ("the map has no free cell: check `negate`",)
    drawn = drawn_plan(plan)
    found = tuple(_disagreements(plan, grid, drawn))
    if found:
        return found
    on_map = tuple(_unreachable(plan, Floor.of(grid), "on the map"))
    return on_map or tuple(_unreachable(plan, Floor.of(drawn), "in the plan"))


@dataclass(frozen=True, eq=False)
class Floor:
    """The floor on which a robot's centre can be: `clearance` (h, w) in metres from the nearest
    cell that is not free, `region` (h, w) numbers of connected floor.
    """

    grid: OccupancyGrid
    clearance: Floats
    region: npt.NDArray[np.int32]

    @classmethod
    def of(cls, grid: OccupancyGrid) -> "Floor":
        """Return the floor of a map; all doors count as open, because maps do not show them."""
        clearance = (
            scipy.ndimage.distance_transform_edt(np.pad(grid.free(), 1))[1:-1, 1:-1]
            * grid.transform.resolution
        )
        return cls(grid, clearance, scipy.ndimage.label(clearance >= HALF_WIDTH)[0])

    @property
    def largest(self) -> int:
        """The number of the largest region, 0 when there is none."""
        sizes = np.bincount(self.region.ravel())[1:]
        return int(np.argmax(sizes)) + 1 if len(sizes) else 0

    def about(self, x: float, y: float, radius: float) -> tuple[float, set[int]]:
        """Return the greatest clearance within `radius` of a point, and the regions there."""
        row, column = self.grid.transform.to_cell(x, y)
        reach = math.ceil(radius / self.grid.transform.resolution)
        rows = slice(max(0, row - reach), max(0, row + reach + 1))
        columns = slice(max(0, column - reach), max(0, column + reach + 1))
        clearance = self.clearance[rows, columns]
        regions = set(np.unique(self.region[rows, columns]).tolist()) - {0}
        return (float(clearance.max()) if clearance.size else 0.0), regions

    def is_reached(self, x: float, y: float) -> bool:
        """Tell whether a robot can be at a point, and get there from most of the floor."""
        return self.largest in self.about(x, y, self.grid.transform.resolution)[1]

    def is_open(self, opening: Door | Passage) -> bool:
        """Tell whether a robot fits through an opening."""
        x, y = (opening.start[0] + opening.end[0]) / 2.0, (opening.start[1] + opening.end[1]) / 2.0
        return self.about(x, y, WALL_TOLERANCE)[0] >= HALF_WIDTH


@dataclass(frozen=True, eq=False)
class Landmarks:
    """The features of a plan that a map must show: points (n, 2) on walls, each with the distance
    (n,) that still counts as shown, and (m, 2) on free floor.
    """

    walls: Floats
    near_enough: Floats
    floor: Floats

    @classmethod
    def of(cls, plan: FloorPlan, drawn: OccupancyGrid) -> "Landmarks":
        """Return the landmarks of a plan and of its drawing."""
        counts = [
            min(MOST_SAMPLES, max(2, math.ceil(math.dist(wall.start, wall.end) / SAMPLE)))
            for wall in plan.walls
        ]
        walls = [
            np.linspace(wall.start, wall.end, count)
            for wall, count in zip(plan.walls, counts, strict=True)
        ]
        rows, columns = drawn.free().nonzero()
        every = max(1, len(rows) // MOST_SAMPLES)
        pixels = zip(columns[::every].tolist(), rows[::every].tolist(), strict=True)
        floor = np.array(
            [drawn.transform.to_world(column + 0.5, row + 0.5) for column, row in pixels]
        ).reshape(-1, 2)
        tolerances = [WALL_TOLERANCE + wall.thickness / 2.0 for wall in plan.walls]
        return cls(np.concatenate(walls), np.repeat(tolerances, counts), floor)

    def shown(self, grid: OccupancyGrid) -> tuple[float, float]:
        """Return which shares of the walls and of the floor a map shows."""
        near = scipy.ndimage.distance_transform_edt(~grid.occupied()) * grid.transform.resolution
        floor = grid.free()[_cells(grid, self.floor)]
        return float((near[_cells(grid, self.walls)] <= self.near_enough).mean()), (
            float(floor.mean()) if len(floor) else 0.0
        )


def _disagreements(plan: FloorPlan, grid: OccupancyGrid, drawn: OccupancyGrid) -> Iterator[str]:
    corners = np.vstack([np.array(room.polygon) for room in plan.rooms])
    if not all(_inside(grid, x, y) for x, y in corners.tolist()):
        height, width = grid.image.shape
        ends = ((0, 0), (width, 0), (0, height), (width, height))
        extent = [grid.transform.to_world(u, v) for u, v in ends]
        yield (
            f"the plan's rooms reach from {_span(corners)}, but the map only covers"
            f" {_span(np.array(extent))}"
        )
        return
    landmarks = Landmarks.of(plan, drawn)
    walls, floor = landmarks.shown(grid)
    if walls < WALLS_SHOWN:
        yield (
            f"plan and map do not show the same place: only {walls:.0%} of the "
            "plan's walls are on the map; check resolution and origin"
        )
    elif floor < FLOOR_SHOWN:
        yield (
            f"plan and map do not show the same place: only {floor:.0%} of the plan's floor is free"
            " on the map"
        )
    else:
        yield from _bad_scale(landmarks, grid, walls + floor)


def _bad_scale(landmarks: Landmarks, grid: OccupancyGrid, fit: float) -> Iterator[str]:
    for scale in OTHER_SCALES:
        resolution = grid.transform.resolution * scale
        other = replace(grid, transform=replace(grid.transform, resolution=resolution))
        if sum(landmarks.shown(other)) > fit + MUCH_BETTER:
            yield (
                f"plan and map differ in scale: they fit better at {resolution:g} m "
                f"per pixel than at {grid.transform.resolution:g}"
            )
            return


def _inside(grid: OccupancyGrid, x: float, y: float) -> bool:
    row, column = grid.transform.to_cell(x, y)
    height, width = grid.image.shape
    return bool(-1 <= row <= height and -1 <= column <= width)


def _span(points: Floats) -> str:
    low, high = points.min(axis=0), points.max(axis=0)
    return f"({low[0]:g}, {low[1]:g}) to ({high[0]:g}, {high[1]:g}) m"


def _cells(
    grid: OccupancyGrid, points: Floats
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the rows and columns of (n, 2) points of the world; points outside of the map are
    moved to its border.
    """
    height, width = grid.image.shape
    in_map = points_in_frame(grid.transform.origin, points) / grid.transform.resolution
    columns, up = np.floor(in_map).astype(np.intp).T
    return np.clip(height - 1 - up, 0, height - 1), np.clip(columns, 0, width - 1)


def drawn_plan(plan: FloorPlan) -> OccupancyGrid:
    """Return the plan as a map, coarser than usual where it is very large."""
    corners = np.vstack([np.array(room.polygon) for room in plan.rooms])
    width, height = (corners.max(axis=0) - corners.min(axis=0)).tolist()
    return rasterise(plan, max(RESOLUTION, math.sqrt(width * height / MOST_CELLS)))


def _unreachable(plan: FloorPlan, floor: Floor, where: str) -> Iterator[str]:
    main = floor.largest
    if not main:
        yield f"there is not enough room for a robot anywhere {where}"
        return
    for opening in plan.openings:
        if not floor.is_open(opening):
            yield f"{opening.name!r} is blocked or too narrow for a robot {where}"
    for dock in plan.docks:
        yield from _bad_dock(dock, floor, where, main)
    spots: Spots = [(f"place {place.name!r}", place.x, place.y) for place in plan.places]
    spots += [(f"start {start.name!r}", start.x, start.y) for start in plan.starts]
    for what, x, y in spots:
        yield from _bad_spot(what, floor.about(x, y, floor.grid.transform.resolution), where, main)
    for route in plan.routes:
        for checkpoint in route.checkpoints:
            what = f"checkpoint {checkpoint.number} of {route.type!r}"
            yield from _bad_spot(
                what, floor.about(checkpoint.x, checkpoint.y, checkpoint.radius / 2.0), where, main
            )


def _bad_spot(what: str, about: tuple[float, set[int]], where: str, main: int) -> Iterator[str]:
    clearance, regions = about
    if clearance <= 0.0:
        yield f"{what} is in a wall or in furniture {where}"
    elif not regions:
        yield (
            f"{what} is too close to a wall or furniture {where}: a robot needs "
            f"{HALF_WIDTH} m around its centre"
        )
    elif main not in regions:
        yield f"{what} cannot be reached {where}"


def _bad_dock(dock: ChargingDock, floor: Floor, where: str, main: int) -> Iterator[str]:
    """Check the path straight back out of a dock: a docked robot itself is close to its station."""
    cell = floor.grid.transform.resolution
    docked = Pose2D(dock.x, dock.y, dock.theta)
    for back in np.arange(0.0, BACKED_OUT + SAMPLE, SAMPLE).tolist():
        x, y = docked.apply(-back, 0.0)
        if floor.about(x, y, cell)[0] < HALF_WIDTH - 2.0 * cell:
            yield (
                f"dock {dock.name!r} is not free {where}: there is an obstacle at "
                f"({x:.2f}, {y:.2f}), {back:.1f} m behind the docked robot's centre"
            )
            return
    x, y = docked.apply(-BACKED_OUT, 0.0)
    if main not in floor.about(x, y, 2.0 * cell)[1]:
        yield f"dock {dock.name!r} cannot be reached {where}"
