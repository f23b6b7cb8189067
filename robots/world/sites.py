"""A site is a folder: plan.json, and the map_server map of the same place."""

from dataclasses import dataclass
from pathlib import Path

from robots.api import floorplan
from robots.api.floorplan import FloorPlan, FloorPlanError
from robots.world.grid import MapError, OccupancyGrid, load_grid

SHIPPED = Path(__file__).parent / "plans"


class SiteError(ValueError):
    """A site cannot be used; the message is one sentence."""


@dataclass(frozen=True)
class Site:
    """A plan and its map."""

    plan: FloorPlan
    grid: OccupancyGrid
    directory: Path


def shipped_sites() -> tuple[str, ...]:
    """Return the names of the sites that come with the project."""
    return tuple(sorted(path.parent.name for path in SHIPPED.glob("*/plan.json")))


def load_plan(name: str) -> tuple[FloorPlan, Path]:
    """Return the plan of a shipped site, or of a folder, and the folder.

    Raises:
        SiteError: there is none, or it cannot be used.
    """
    directory = SHIPPED / name if name in shipped_sites() else Path(name)
    try:
        return floorplan.decode((directory / "plan.json").read_bytes()), directory
    except OSError as error:
        raise SiteError(
            f"no site {name!r}: give one of {', '.join(shipped_sites())}, or a "
            "folder with a plan.json"
        ) from error
    except FloorPlanError as error:
        raise SiteError(f"{directory / 'plan.json'}: {error}") from error


def load_site(name: str) -> Site:
    """Return a shipped site by name, or one in a folder.

    Raises:
        SiteError: plan or map are missing or cannot be used.
    """
    plan, directory = load_plan(name)
    try:
        return Site(plan, load_grid(directory / "map.yaml"), directory)
    except MapError as error:
        raise SiteError(str(error)) from error


def with_doors(
    plan: FloorPlan, doors: dict[str, floorplan.DoorState]
) -> dict[str, floorplan.DoorState]:
    """Return the state of every door: the plan's, changed by `doors`; ignores unknown names."""
    return {door.name: doors.get(door.name, door.state) for door in plan.doors}
