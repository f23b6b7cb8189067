"""Import of a site by the command, into the database and the simulator."""

import json
import shutil
from io import StringIO
from pathlib import Path

import pytest
from django.core.management import CommandError, call_command

from robots.models import FloorPlan
from robots.simulator.physics.simulation import Simulation
from robots.world.grid import decode_grey, encode_png
from robots.world.robot_models import GIRAFF
from robots.world.sites import SHIPPED, load_site

pytestmark = pytest.mark.django_db


@pytest.fixture
def var(settings, tmp_path):
    settings.VAR_DIR = tmp_path / "var"
    return settings.VAR_DIR


@pytest.fixture
def folder(tmp_path) -> Path:
    """A copy of the clinic with another name, and a PGM image with another file name."""
    made = tmp_path / "elsewhere"
    shutil.copytree(SHIPPED / "clinic", made)
    plan = json.loads((made / "plan.json").read_text())
    del plan["translations"]  # of its former titles
    plan |= {"mapId": "our-clinic", "title": "Our clinic"}
    (made / "plan.json").write_text(json.dumps(plan))
    grey = decode_grey((made / "map.png").read_bytes(), "map.png")
    (made / "first_floor.pgm").write_bytes(
        b"P5 %d %d 255\n" % (grey.shape[1], grey.shape[0]) + grey.tobytes()
    )
    (made / "map.png").unlink()
    change_map(made, "map.png", "first_floor.pgm")
    return made


def change_map(folder: Path, old: str, new: str) -> None:
    text = (folder / "map.yaml").read_text()
    (folder / "map.yaml").write_text(text.replace(old, new))


def change_plan(folder: Path, **parts: object) -> None:
    plan = json.loads((folder / "plan.json").read_text())
    (folder / "plan.json").write_text(json.dumps(plan | parts))


def take(folder: Path, *options: str) -> str:
    out = StringIO()
    call_command("import_floorplan", str(folder), *options, stdout=out)
    return out.getvalue()


def test_site_is_imported_into_database_and_simulator(folder, var):
    printed = take(folder)
    assert "Imported the site our-clinic (Our clinic)." in printed
    assert f"plan={var / 'sites' / 'our-clinic'}" in printed
    assert FloorPlan.objects.get().name == "our-clinic"
    site = load_site(str(var / "sites" / "our-clinic"))
    assert (site.grid.image == load_site("clinic").grid.image).all()
    assert Simulation(GIRAFF, site.plan, seed=1).docked
    assert sorted(path.name for path in (var / "sites").iterdir()) == ["our-clinic"]


def test_imported_site_replaces_its_earlier_version(folder, var):
    take(folder)
    change_plan(folder, title="Rebuilt")
    assert "Replaced the site our-clinic (Rebuilt)." in take(folder)
    assert FloorPlan.objects.get().title == "Rebuilt"
    assert load_site(str(var / "sites" / "our-clinic")).plan.title == "Rebuilt"


def test_check_changes_nothing(folder, var):
    assert "can be used" in take(folder, "--check")
    assert not FloorPlan.objects.exists()
    assert not var.exists()


def without_free_floor(folder: Path) -> None:
    change_map(folder, "negate: 0", "negate: 1")
    grey = decode_grey((folder / "first_floor.pgm").read_bytes(), "map") * 0 + 254
    (folder / "first_floor.pgm").write_bytes(encode_png(grey))


NOOK = {"name": "nook", "title": "Nook", "x": 3.2, "y": 7.7}
FAULTS = {
    "No such file": shutil.rmtree,
    r"plan\.json: No such file": lambda folder: (folder / "plan.json").unlink(),
    r"map\.yaml": lambda folder: (folder / "map.yaml").unlink(),
    r"first_floor\.pgm": lambda folder: (folder / "first_floor.pgm").unlink(),
    r"plan\.json: JSON is malformed": lambda folder: (folder / "plan.json").write_text("{,"),
    "unknown field `docs`": lambda folder: change_plan(folder, docs=[]),
    "no free cell": without_free_floor,
    "do not show the same place": lambda folder: change_map(folder, "0.05", "0.2"),
    "Place 'nook' is in a wall or in furniture on the map.": lambda folder: change_plan(
        folder, places=[NOOK]
    ),
    "map id must be at most 50": lambda folder: change_plan(folder, mapId="a" * 60),
}


@pytest.mark.parametrize("words", FAULTS)
def test_unusable_site_is_refused_with_the_reason_and_changes_nothing(folder, var, words):
    take(folder)
    before = FloorPlan.objects.get()
    FAULTS[words](folder)
    with pytest.raises(CommandError, match=words):
        take(folder)
    now = FloorPlan.objects.get()
    assert (now.sha256, now.plan, now.title) == (before.sha256, before.plan, before.title)
    assert load_site(str(var / "sites" / "our-clinic")).plan.title == "Our clinic"
