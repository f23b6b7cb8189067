"""The site in which a robot navigates: its map, and its plan if there is one, as sent in the
server's `floorplan` message.
"""

import base64
import binascii
import hashlib
import json
from dataclasses import dataclass

import structlog

from robots.api import floorplan
from robots.api.floorplan import ChargingDock, FloorPlan, FloorPlanError
from robots.api.geometry import MapTransform, Pose2D
from robots.api.messages import FloorPlanUpdate
from robots.world.grid import MapError, OccupancyGrid, decode_grey, encode_png
from robots.world.sites import Site

log = structlog.stdlib.get_logger(__name__)


class AreaError(ValueError):
    """A map or plan that a robot cannot find its way in, in one sentence."""


@dataclass(frozen=True)
class Area:
    """`plan` is None when the site has a map and nothing else: no docks, no named places."""

    grid: OccupancyGrid
    plan: FloorPlan | None


def area_of(update: FloorPlanUpdate) -> Area:
    """Return the site of a `floorplan` message; raises AreaError for an unusable image or plan."""
    try:
        data = base64.b64decode(update.image, validate=True)
        image = decode_grey(data, f"the map {update.map_id!r}")
    except (MapError, binascii.Error) as error:
        raise AreaError(str(error)) from error
    transform = MapTransform(update.resolution, Pose2D(*update.origin), image.shape[0])
    grid = OccupancyGrid(
        image, transform, update.negate, update.occupied_thresh, update.free_thresh
    )
    return Area(grid, plan_of(update))


def plan_of(update: FloorPlanUpdate) -> FloorPlan | None:
    """Return a `floorplan` message's plan, None without one; raises AreaError."""
    if update.plan is None:
        return None
    try:
        return floorplan.decode(json.dumps(update.plan))
    except FloorPlanError as error:
        raise AreaError(f"the plan of {update.map_id!r} cannot be used: {error}") from error


def update_of(site: Site) -> FloorPlanUpdate:
    image, transform = encode_png(site.grid.image), site.grid.transform
    return FloorPlanUpdate(
        map_id=site.plan.map_id,
        sha256=hashlib.sha256(image).hexdigest(),
        resolution=transform.resolution,
        origin=(transform.origin.x, transform.origin.y, transform.origin.theta),
        negate=site.grid.negate,
        occupied_thresh=site.grid.occupied_thresh,
        free_thresh=site.grid.free_thresh,
        image=base64.b64encode(image).decode(),
        plan=json.loads(floorplan.encode(site.plan)),
    )


def own_dock(plan: FloorPlan | None, series: str) -> ChargingDock | None:
    """Return the dock of a series of robots, None unless there is exactly one."""
    docks = [dock for dock in plan.docks if dock.type == series] if plan else []
    return docks[0] if len(docks) == 1 else None


def dock_of(update: FloorPlanUpdate, series: str) -> ChargingDock | None:
    """Return the same for a `floorplan` message; None also when its plan cannot be used."""
    try:
        return own_dock(plan_of(update), series)
    except AreaError as error:
        log.warning("plan_refused", reason=str(error))
        return None
