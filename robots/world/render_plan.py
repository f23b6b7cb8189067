"""plan.json to map.png and map.yaml: `python -m robots.world.render_plan DIRECTORY`.

A cell is occupied when at least half of it is, unknown outside of the rooms, free elsewhere. Doors
are left out, because they open and close.
"""

import argparse
import logging
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import numpy.typing as npt
import structlog

from robots.api import floorplan
from robots.api.floorplan import FloorPlan
from robots.api.geometry import MapTransform, Pose2D
from robots.world.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, write_grid
from robots.world.sensing import points_from_frame, points_in_frame
from robots.world.solids import Floats, bar, fixed_solids, inside, station_solid

RESOLUTION = 0.05
MARGIN = 0.1
SAMPLES = 4  # a side of a cell
BEHIND = 0.15  # m behind a station, between it and its wall, that no laser sees into

log = structlog.stdlib.get_logger(__name__)


def rasterise(plan: FloorPlan, resolution: float = RESOLUTION) -> OccupancyGrid:
    """Return the map of a plan, with its origin on a whole cell."""
    solids = fixed_solids(plan)
    corners = np.vstack([solid.outline for solid in solids])
    low = np.floor((corners.min(axis=0) - MARGIN) / resolution + 1e-6).astype(int)
    high = np.ceil((corners.max(axis=0) + MARGIN) / resolution - 1e-6).astype(int)
    columns, rows = (high - low).tolist()
    x, y = _points(low, rows, columns, resolution, SAMPLES)
    occupied = np.zeros(x.shape, dtype=np.bool_)
    for solid in solids:
        near = _window(solid.outline, x[0], y[:, 0])
        occupied[near] |= inside(solid.outline, x[near], y[near])
    share = occupied.reshape(rows, SAMPLES, columns, SAMPLES).mean(axis=(1, 3))
    image = np.full((rows, columns), UNKNOWN, dtype=np.uint8)
    image[_indoors(plan, *_points(low, rows, columns, resolution, 1))] = FREE
    image[share >= 0.5] = OCCUPIED
    origin = Pose2D(round(float(low[0]) * resolution, 6), round(float(low[1]) * resolution, 6), 0.0)
    return OccupancyGrid(image, MapTransform(resolution, origin, rows))


def with_stations(grid: OccupancyGrid, plan: FloorPlan) -> OccupancyGrid:
    """Return a map with the charging stations of a plan, which are placed after a robot has made
    its map.

    A docked robot sees little else: without them, or with a gap behind them, it would take the
    station for the wall behind.
    """
    image, transform = grid.image.copy(), grid.transform
    top = np.array([0.0, transform.height * transform.resolution])
    scale = transform.resolution * np.array([1.0, -1.0])
    for dock in plan.docks:
        depth = dock.station.depth + BEHIND
        station = msgspec.structs.replace(dock.station, depth=depth)
        outline = station_solid(msgspec.structs.replace(dock, station=station)).outline
        pixels = (points_in_frame(transform.origin, outline) - top) / scale
        low = np.maximum(np.floor(pixels.min(axis=0)), 0).astype(int)
        high = np.minimum(np.ceil(pixels.max(axis=0)), image.shape[::-1]).astype(int)
        columns, rows = np.maximum(high - low, 0).tolist()
        u, v = np.meshgrid(
            low[0] + (np.arange(columns * SAMPLES) + 0.5) / SAMPLES,
            low[1] + (np.arange(rows * SAMPLES) + 0.5) / SAMPLES,
        )
        world = points_from_frame(transform.origin, np.column_stack([u.flat, v.flat]) * scale + top)
        covered = inside(outline, world[:, 0], world[:, 1])
        share = covered.reshape(rows, SAMPLES, columns, SAMPLES).mean(axis=(1, 3))
        image[low[1] : low[1] + rows, low[0] : low[0] + columns][share >= 0.5] = (
            255 if grid.negate else OCCUPIED
        )
    return replace(grid, image=image)


def _points(
    low: npt.NDArray[np.int_], rows: int, columns: int, resolution: float, samples: int
) -> tuple[Floats, Floats]:
    """Return x and y (rows * samples, columns * samples) of points in each cell, evenly spaced."""
    across = (low[0] + (np.arange(columns * samples) + 0.5) / samples) * resolution
    up = (low[1] + rows - (np.arange(rows * samples) + 0.5) / samples) * resolution
    x, y = np.meshgrid(across, up)
    return x, y


def _window(outline: Floats, across: Floats, up: Floats) -> tuple[slice, slice]:
    """Return the rows and columns about an outline; `up` falls from row to row."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    rows = len(up) - np.searchsorted(up[::-1], [high[1], low[1]], side="right")
    columns = np.searchsorted(across, [low[0], high[0]])
    return slice(int(rows[0]), int(rows[1]) + 1), slice(int(columns[0]), int(columns[1]) + 1)


def _indoors(plan: FloorPlan, x: Floats, y: Floats) -> npt.NDArray[np.bool_]:
    result = np.zeros(x.shape, dtype=np.bool_)
    for room in plan.rooms:
        result |= _in_polygon(np.array(room.polygon), x, y)
    for opening in plan.openings:
        result |= inside(bar(opening.start, opening.end, opening.thickness), x, y)
    return result


def _in_polygon(polygon: Floats, x: Floats, y: Floats) -> npt.NDArray[np.bool_]:
    result = np.zeros(x.shape, dtype=np.bool_)
    for (ax, ay), (bx, by) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if ay != by:
            result ^= ((ay > y) != (by > y)) & (x < ax + (y - ay) / (by - ay) * (bx - ax))
    return result


def write_map(directory: Path) -> OccupancyGrid:
    """Draw `directory`/plan.json into map.png and map.yaml beside it.

    Raises:
        FloorPlanError: the plan cannot be used.
        OSError: a file cannot be read or written.
    """
    grid = rasterise(floorplan.decode((directory / "plan.json").read_bytes()))
    write_grid(grid, directory)
    return grid


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO)
    parser = argparse.ArgumentParser(description="Draw a plan.json into a map_server map.")
    parser.add_argument("directory", type=Path)
    target = parser.parse_args().directory
    drawn = write_map(target)
    log.info("map_written", directory=str(target), cells=drawn.image.size)
