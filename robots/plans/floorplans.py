"""Floor plans in the database, read from a site's folder or an upload."""

import tempfile
from pathlib import Path
from typing import Any

from django.conf import settings
from django.urls import reverse
from django.utils.translation import get_language

from robots.files.limited_process import ImportRefusedError, run_limited
from robots.models import FloorPlan
from robots.world import site_files
from robots.world.grid import load_grid, write_grid

FloorPlanRefusedError = site_files.FloorPlanRefusedError
read_folder = site_files.read_folder
MAX_YAML = 64 * 1024
MAX_IMAGE = 8 * 1024 * 1024
MAX_PLAN = 256 * 1024


def store_floor_plan(directory: Path) -> FloorPlan:
    """Store the site of a folder (map.yaml with its image, plan.json), in place of one with the
    same map id.

    Raises:
        FloorPlanRefusedError: a file is missing or cannot be used.
    """
    values = read_folder(directory)
    row, _ = FloorPlan.objects.update_or_create(name=values["name"], defaults=values)
    return row


def import_site(directory: Path) -> tuple[FloorPlan, Path]:
    """Store the site of a folder in the database, and a copy of the folder for simulators, in place
    of a site with the same map id; return both.

    The map is written from the checked data: the image that the folder's map.yaml names may be in
    another folder.

    Raises:
        FloorPlanRefusedError: a file is missing or cannot be used.
        OSError: the copy cannot be written.
    """
    sites = settings.VAR_DIR / "sites"
    kept = sites / read_folder(directory)["name"]
    sites.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=sites, prefix=".") as folder:
        fresh = Path(folder) / "new"
        fresh.mkdir()
        (fresh / "plan.json").write_bytes((directory / "plan.json").read_bytes())
        write_grid(load_grid(directory / "map.yaml"), fresh)
        if kept.exists():
            kept.rename(Path(folder) / "old")
        fresh.rename(kept)
    return store_floor_plan(kept), kept


def read_upload(
    map_yaml: bytes, image: bytes, plan_json: bytes | None, *, name: str = "", title: str = ""
) -> dict[str, Any]:
    """Return the fields of a FloorPlan from uploaded files, which a child process reads. Without a
    plan.json, map id and title are required.

    Raises:
        FloorPlanRefusedError: something cannot be used.
    """
    try:
        values: dict[str, Any] = run_limited(
            site_files.read_upload, map_yaml, image, plan_json, name, title
        )
    except ImportRefusedError as error:
        raise FloorPlanRefusedError(*error.problems) from error
    return values


def plan_content(plan: FloorPlan) -> dict[str, Any]:
    """Return what a page needs to draw a map: metres a pixel, the pose of the lower left corner,
    the address of the image, and the plan in the language of the page.
    """
    return {
        "name": plan.name,
        "title": plan.shown_title,
        "resolution": plan.resolution,
        "origin": [plan.origin_x, plan.origin_y, plan.origin_theta],
        "width": plan.width,
        "height": plan.height,
        "image": f"{reverse('floor_plan_image', args=[plan.name])}?v={plan.sha256[:16]}",
        "plan": plan.plan_in(get_language() or ""),
    }
