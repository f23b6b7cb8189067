"""Sites from maps: a plan is proposed for a map, stored as a floor plan, and finished on a page."""

import json
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from django.utils.translation import gettext as _

from robots.api import floorplan
from robots.api.floorplan import FloorPlanError
from robots.api.geometry import MapTransform, Pose2D
from robots.models import FloorPlan
from robots.plans.floorplans import FloorPlanRefusedError, import_site
from robots.world.grid import MapError, OccupancyGrid, decode_grey, load_grid, write_grid
from robots.world.inspection import inspect_site
from robots.world.robot_models import MODELS
from robots.world.tracing.proposal import Titles, propose_plan
from robots.world.tracing.structure import TracingError


def titles() -> Titles:
    """Return titles for proposed parts, in the language of the request."""
    return Titles(
        room=_("Room"),
        corridor=_("Corridor"),
        opening=_("Opening"),
        station=_("Charging station"),
    )


def read_map(path: Path, *, occupied: float | None, free: float | None) -> OccupancyGrid:
    """Return the map of a map_server YAML file, with other thresholds if given.

    Raises:
        FloorPlanRefusedError: it cannot be read.
    """
    try:
        grid = load_grid(path)
    except MapError as error:
        raise FloorPlanRefusedError(f"{error}.") from error
    return replace(
        grid,
        occupied_thresh=grid.occupied_thresh if occupied is None else occupied,
        free_thresh=grid.free_thresh if free is None else free,
    )


def grid_of(row: FloorPlan) -> OccupancyGrid:
    """Return the map of a stored floor plan.

    Raises:
        FloorPlanRefusedError: its image cannot be read.
    """
    origin = Pose2D(row.origin_x, row.origin_y, row.origin_theta)
    try:
        image = decode_grey(bytes(row.image), row.name)
    except MapError as error:
        raise FloorPlanRefusedError(f"{error}.") from error
    return OccupancyGrid(
        image=image,
        transform=MapTransform(row.resolution, origin, row.height),
        negate=row.negate,
        occupied_thresh=row.occupied_thresh,
        free_thresh=row.free_thresh,
    )


def propose(grid: OccupancyGrid, name: str, title: str) -> floorplan.FloorPlan:
    """Return the plan that is proposed for a map.

    Raises:
        FloorPlanRefusedError: nothing can be proposed, or the proposal is not a valid plan.
    """
    try:
        plan = propose_plan(grid, name, title, titles())
        return floorplan.decode(floorplan.encode(plan))
    except TracingError as error:
        raise FloorPlanRefusedError(f"{str(error)[0].upper()}{str(error)[1:]}.") from error
    except FloorPlanError as error:
        raise FloorPlanRefusedError(*(f"{problem}." for problem in error.problems)) from error


def store_site(plan: floorplan.FloorPlan, grid: OccupancyGrid) -> tuple[FloorPlan, Path]:
    """Store a plan and its map as a site, as `import_site` does.

    Raises:
        FloorPlanRefusedError: they cannot be a site.
        OSError: the folder cannot be written.
    """
    with tempfile.TemporaryDirectory() as folder:
        directory = Path(folder)
        (directory / "plan.json").write_bytes(floorplan.encode(plan))
        write_grid(grid, directory)
        return import_site(directory)


def checked(document: dict[str, Any], grid: OccupancyGrid) -> floorplan.FloorPlan:
    """Return the plan of a document.

    Raises:
        FloorPlanRefusedError: it cannot be used; `problems` say why.
    """
    try:
        plan = floorplan.decode(json.dumps(document))
        problems = inspect_site(plan, grid)
    except FloorPlanError as error:
        problems = error.problems
    if problems:
        raise FloorPlanRefusedError(*(f"{text[0].upper()}{text[1:]}." for text in problems))
    return plan


def free_at(grid: OccupancyGrid) -> Callable[[float, float], bool]:
    """Return a function that tells whether a point of the world is free on a map."""
    free = grid.free()

    def is_free(x: float, y: float) -> bool:
        row, column = grid.transform.to_cell(x, y)
        return 0 <= row < free.shape[0] and 0 <= column < free.shape[1] and bool(free[row, column])

    return is_free


def series_titles() -> dict[str, str]:
    """Return the series of robots that a charging station can be for, and their names."""
    return {series: model.title for series, model in MODELS.items()}
