"""The sites that come with the project: their parts agree, and each is a place the task needs."""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from robots.api.floorplan import DoorState
from robots.simulator.physics.simulation import Simulation
from robots.world import sites
from robots.world.inspection import inspect_site
from robots.world.render_plan import rasterise, write_map
from robots.world.robot_models import MODELS, RobotModel
from robots.world.solids import leaf_solid

OFFICE = sites.load_site("office")
PLAN = OFFICE.plan
SITES = [sites.load_site(name) for name in sites.shipped_sites()]
each_site = pytest.mark.parametrize("site", SITES, ids=lambda site: site.plan.map_id)


def rooms_apart(site: sites.Site, closed: set[str], radius: float = 0.33) -> np.ndarray:
    """Return labels of the places that a robot of `radius` can reach from each other with some
    doors closed.
    """
    grid = site.grid
    free = grid.free().copy()
    rows, columns = np.indices(free.shape)
    x = grid.transform.origin.x + (columns + 0.5) * grid.transform.resolution
    y = grid.transform.origin.y + (free.shape[0] - rows - 0.5) * grid.transform.resolution
    for door in site.plan.doors:
        state: DoorState = "closed" if door.name in closed else "open"
        outline = leaf_solid(door, state).outline
        low, high = outline.min(axis=0) - 0.02, outline.max(axis=0) + 0.02
        free[(x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])] = False
    return ndimage.label(ndimage.distance_transform_edt(free) * grid.transform.resolution > radius)[
        0
    ]


def label_at(site: sites.Site, labels: np.ndarray, x: float, y: float) -> int:
    row, column = site.grid.transform.to_cell(x, y)
    return int(labels[row - 4 : row + 5, column - 4 : column + 5].max())


@each_site
def test_the_committed_map_is_the_plan_drawn(site: sites.Site) -> None:
    drawn = rasterise(site.plan)
    assert np.array_equal(drawn.image, site.grid.image)
    assert drawn.transform == site.grid.transform


@each_site
def test_a_shipped_site_passes_inspection(site: sites.Site) -> None:
    assert inspect_site(site.plan, site.grid) == ()


def test_a_map_can_be_drawn_and_read_back(tmp_path: Path) -> None:
    (tmp_path / "plan.json").write_bytes((sites.SHIPPED / "office" / "plan.json").read_bytes())
    drawn = write_map(tmp_path)
    assert np.array_equal(sites.load_site(str(tmp_path)).grid.image, drawn.image)


@each_site
def test_with_any_one_door_closed_every_place_is_still_reached(site: sites.Site) -> None:
    for closed in [set(), *({door.name} for door in site.plan.doors)]:
        labels = rooms_apart(site, closed)
        assert len({label_at(site, labels, place.x, place.y) for place in site.plan.places}) == 1, (
            closed
        )
        assert label_at(site, labels, site.plan.places[0].x, site.plan.places[0].y) > 0


def test_with_both_doors_closed_the_offices_corridor_is_shut_off() -> None:
    labels = rooms_apart(OFFICE, {"lab-door", "lounge-door"})
    assert label_at(OFFICE, labels, 5.0, 1.0) != label_at(OFFICE, labels, 3.2, 4.6)


def test_both_doors_of_the_office_lie_on_every_suggested_path() -> None:
    for route in PLAN.routes:
        for door in PLAN.doors:
            x, y = (door.start[0] + door.end[0]) / 2, (door.start[1] + door.end[1]) / 2
            assert any(
                min(a[1], b[1]) <= y <= max(a[1], b[1]) and abs((a[0] + b[0]) / 2 - x) < 0.3
                for a, b in pairwise(route.path)
            ), door.name


@each_site
def test_suggested_paths_lead_over_free_floor(site: sites.Site) -> None:
    labels = rooms_apart(site, set(), radius=0.2)
    for route in site.plan.routes:
        for a, b in pairwise(route.path[1:-1]):  # the ends are docks, closer to a station
            for x, y in np.linspace(a, b, 20):
                row, column = site.grid.transform.to_cell(float(x), float(y))
                assert labels[row, column] > 0, (route.type, x, y)


@each_site
def test_every_robot_has_a_dock_five_checkpoints_and_a_path_between_them(site: sites.Site) -> None:
    for series in MODELS:
        dock, route = site.plan.dock_of(series), site.plan.route_of(series)
        assert dock is not None
        assert route is not None
        assert [c.number for c in route.checkpoints] == [0, 1, 2, 3, 4]
        assert (route.checkpoints[0].x, route.checkpoints[0].y) == (dock.x, dock.y)
        for checkpoint in route.checkpoints:
            away = [math.dist(point, (checkpoint.x, checkpoint.y)) for point in route.path]
            assert min(away) < checkpoint.radius


@each_site
def test_giraffs_fourth_checkpoint_is_before_the_mirror(site: sites.Site) -> None:
    route, mirror = site.plan.route_of("giraff"), site.plan.mirrors[0]
    assert route is not None
    last = route.checkpoints[4]
    assert abs(last.x - mirror.start[0]) < 2.0
    assert min(mirror.start[1], mirror.end[1]) < last.y < max(mirror.start[1], mirror.end[1])
    glass = np.subtract(mirror.end, mirror.start)
    # on its left side
    assert glass[0] * (last.y - mirror.start[1]) - glass[1] * (last.x - mirror.start[0]) > 0.0


@each_site
@pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.series)
def test_every_robot_fits_in_its_dock_and_at_every_start_and_place(
    site: sites.Site, model: RobotModel
) -> None:
    assert Simulation(model, site.plan, seed=1).docked
    for place in (*site.plan.starts, *site.plan.places):
        Simulation(model, site.plan, seed=1, start=place.name)


def test_the_error_of_a_missing_site_lists_the_existing_ones() -> None:
    with pytest.raises(sites.SiteError, match="office"):
        sites.load_plan("castle")


def test_a_site_with_a_bad_plan_or_no_map_is_refused(tmp_path: Path) -> None:
    (tmp_path / "plan.json").write_text("{}", encoding="utf-8")
    with pytest.raises(sites.SiteError, match=r"plan\.json"):
        sites.load_site(str(tmp_path))
    (tmp_path / "plan.json").write_bytes((sites.SHIPPED / "office" / "plan.json").read_bytes())
    with pytest.raises(sites.SiteError, match=r"map\.yaml"):
        sites.load_site(str(tmp_path))


def test_doors_are_as_in_the_plan_unless_given() -> None:
    assert sites.with_doors(PLAN, {}) == {"lab-door": "open", "lounge-door": "open"}
    found = sites.with_doors(PLAN, {"lab-door": "closed", "barn": "open"})
    assert found == {"lab-door": "closed", "lounge-door": "open"}
