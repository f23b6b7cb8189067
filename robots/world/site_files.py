"""The files of a site, a map with its image and a plan, as the fields of a floor plan."""

import hashlib
import json
import re
import tempfile
from pathlib import Path
from typing import Any

from robots.api import floorplan
from robots.api.floorplan import FloorPlanError
from robots.world.grid import MapError, OccupancyGrid, encode_png, load_grid
from robots.world.inspection import inspect_site

# base64 of the image must fit into a FloorPlanUpdate, and both of them into its topic.
MAX_PNG = 512 * 1024
MAX_TITLE = 120
# 200 m by 200 m at 5 cm: data computed from a map take several bytes a cell
MAX_CELLS = 16 * 1024 * 1024
MAP_ID = re.compile(r"[A-Za-z0-9_-]{1,50}")
IMAGE_BEGINNINGS = (b"\x89PNG\r\n\x1a\n", b"P5", b"P2")


class FloorPlanRefusedError(ValueError):
    """A floor plan that cannot be stored; `problems` has a sentence for each reason."""

    def __init__(self, *problems: str) -> None:
        super().__init__(" ".join(problems))
        self.problems = problems


def read_folder(directory: Path) -> dict[str, Any]:
    """Return the fields of a FloorPlan for the site of a folder.

    Raises:
        FloorPlanRefusedError: a file is missing or cannot be used.
    """
    try:
        plan = _plan((directory / "plan.json").read_bytes())
        grid = load_grid(directory / "map.yaml")
    except OSError as error:
        raise FloorPlanRefusedError(f"{error.filename}: {error.strerror}.") from error
    except MapError as error:
        raise FloorPlanRefusedError(f"{error}.") from error
    return _values(plan.map_id, plan.title, grid, plan)


def read_upload(
    map_yaml: bytes, image: bytes, plan_json: bytes | None, name: str = "", title: str = ""
) -> dict[str, Any]:
    """Return the fields of a FloorPlan for uploaded files; without a plan.json the map id and title
    must be given.

    Raises:
        FloorPlanRefusedError: something cannot be used.
    """
    plan = None if plan_json is None else _plan(plan_json)
    name, title = (plan.map_id, title or plan.title) if plan is not None else (name, title)
    if not name or not title:
        raise FloorPlanRefusedError(
            "Without a plan.json the floor plan needs a map id and a title."
        )
    return _values(name, title, _grid(map_yaml, image), plan)


def _plan(data: bytes) -> floorplan.FloorPlan:
    try:
        return floorplan.decode(data)
    except FloorPlanError as error:
        raise FloorPlanRefusedError(
            *(f"plan.json: {problem}." for problem in error.problems)
        ) from error


def _grid(map_yaml: bytes, image: bytes) -> OccupancyGrid:
    """Return the map of two uploaded files. The name of the image in the YAML file is not followed:
    it may point anywhere.
    """
    if not image.startswith(IMAGE_BEGINNINGS):
        raise FloorPlanRefusedError("The image is neither PNG nor PGM.")
    suffix = ".png" if image.startswith(IMAGE_BEGINNINGS[0]) else ".pgm"
    lines = [
        line
        for line in map_yaml.decode("utf-8", "replace").splitlines()
        if not line.lstrip().startswith(("image:", '"image"', "'image'"))
    ]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / f"map{suffix}").write_bytes(image)
        (Path(folder) / "map.yaml").write_text(
            "\n".join([*lines, f"image: map{suffix}", ""]), encoding="utf-8"
        )
        try:
            return load_grid(Path(folder) / "map.yaml")
        except MapError as error:
            raise FloorPlanRefusedError(f"{error}.".replace(folder + "/", "")) from error


def _values(
    name: str, title: str, grid: OccupancyGrid, plan: floorplan.FloorPlan | None
) -> dict[str, Any]:
    if grid.image.size > MAX_CELLS:
        raise FloorPlanRefusedError(
            f"A map of {grid.image.shape[1]} × {grid.image.shape[0]} pixels is "
            "too large for robots; use a coarser resolution."
        )
    image = encode_png(grid.image)
    problems = _problems(name, title, grid, image, plan)
    if problems:
        raise FloorPlanRefusedError(*problems)
    return {
        "name": name,
        "title": title,
        "resolution": grid.transform.resolution,
        "origin_x": grid.transform.origin.x,
        "origin_y": grid.transform.origin.y,
        "origin_theta": grid.transform.origin.theta,
        "negate": grid.negate,
        "occupied_thresh": grid.occupied_thresh,
        "free_thresh": grid.free_thresh,
        "width": grid.image.shape[1],
        "height": grid.image.shape[0],
        "image": image,
        "plan": json.loads(floorplan.encode(plan)) if plan is not None else {},
        "sha256": hashlib.sha256(image).hexdigest(),
    }


def _problems(
    name: str, title: str, grid: OccupancyGrid, image: bytes, plan: floorplan.FloorPlan | None
) -> list[str]:
    found = []
    if not MAP_ID.fullmatch(name):
        found.append("The map id must be at most 50 letters, digits, hyphens and underscores.")
    if len(title) > MAX_TITLE:
        found.append(f"The title must be at most {MAX_TITLE} characters.")
    if len(image) > MAX_PNG:
        found.append(
            f"The map's image takes {len(image) // 1024} kB as a PNG; robots take at most"
            f" {MAX_PNG // 1024} kB."
        )
    if not 0.001 <= grid.transform.resolution <= 10.0:
        found.append(
            f"A resolution of {grid.transform.resolution} m per pixel is not between 0.001 and 10."
        )
    if not 0.0 <= grid.free_thresh <= grid.occupied_thresh <= 1.0:
        found.append("The thresholds must be 0 ≤ free_thresh ≤ occupied_thresh ≤ 1.")
    if not grid.free().any():
        found.append("The map has no free cell: is `negate` right?")
    origin = grid.transform.origin
    if not (abs(origin.x) <= 1e5 and abs(origin.y) <= 1e5 and abs(origin.theta) <= 7.0):
        found.append("The origin must be (x, y, θ) in metres and radians.")
    if plan is not None and not found:
        found += [f"{problem[0].upper()}{problem[1:]}." for problem in inspect_site(plan, grid)]
    return found
