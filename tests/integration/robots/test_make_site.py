"""A site from a robot's map, through the command, into database and simulator."""

from io import StringIO

import numpy as np
import pytest
from django.core.management import CommandError, call_command

from robots.models import FloorPlan
from robots.simulator.physics.simulation import Simulation
from robots.world.robot_models import GIRAFF
from robots.world.sites import load_site
from tests.support.agents.mapped_building import building, mapped

pytestmark = pytest.mark.django_db


@pytest.fixture(autouse=True)
def var(settings, tmp_path):
    settings.VAR_DIR = tmp_path / "var"
    return settings.VAR_DIR


@pytest.fixture
def folder(tmp_path):
    """A map as written by map_saver."""
    grid = mapped(building(furnished=True), np.random.default_rng(1))
    height, width = grid.image.shape
    origin = grid.transform.origin
    (tmp_path / "hall.pgm").write_bytes(
        b"P5\n# CREATOR: map_saver.cpp 0.050 m/pix\n%d %d\n255\n" % (width, height)
        + grid.image.tobytes()
    )
    (tmp_path / "hall.yaml").write_text(
        f"image: hall.pgm\nresolution: 0.05\norigin: [{origin.x}, {origin.y}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return tmp_path


def make(folder, *options: str) -> str:
    out = StringIO()
    call_command("make_site", str(folder / "hall.yaml"), "--name", "hall", *options, stdout=out)
    return out.getvalue()


def test_map_becomes_a_site_for_pages_and_simulators(folder, var):
    printed = make(folder, "--title", "Our hall")
    assert "Made the site hall: 3 rooms" in printed
    assert "2 openings" in printed
    row = FloorPlan.objects.get()
    assert (row.name, row.title) == ("hall", "Our hall")
    assert f"/admin/robots/floorplan/{row.pk}/finish/" in printed
    site = load_site(str(var / "sites" / "hall"))
    assert Simulation(GIRAFF, site.plan, seed=1).docked


def test_finished_plan_is_replaced_only_on_request(folder):
    make(folder)
    FloorPlan.objects.update(title="By hand")
    with pytest.raises(CommandError, match="--replace"):
        make(folder)
    assert FloorPlan.objects.get().title == "By hand"
    make(folder, "--replace", "--title", "New")
    assert FloorPlan.objects.get().title == "New"


def test_grey_walls_need_another_threshold(folder):
    data = (folder / "hall.pgm").read_bytes()
    head = data.index(b"255\n") + 4
    (folder / "hall.pgm").write_bytes(data[:head] + data[head:].replace(b"\x00", b"\x96"))
    with pytest.raises(CommandError, match="lower threshold"):
        make(folder)
    assert "3 rooms" in make(folder, "--occupied-thresh", "0.35")
    assert FloorPlan.objects.get().occupied_thresh == 0.35


@pytest.mark.parametrize("name", ["Bad Name", "-x"])
def test_bad_name_is_refused(folder, name):
    with pytest.raises(CommandError, match=r"\$\.mapId"):
        call_command("make_site", str(folder / "hall.yaml"), f"--name={name}", stdout=StringIO())
    assert not FloorPlan.objects.exists()


def test_missing_image_is_named(folder):
    (folder / "hall.pgm").unlink()
    with pytest.raises(CommandError, match=r"hall\.pgm"):
        make(folder)
