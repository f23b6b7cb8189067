"""Floor plans are stored, and sent to robots and pages."""

import base64
import hashlib
import json

import msgspec
import numpy as np
import pytest

from robots.api import floorplan
from robots.api.codec import decode, encode
from robots.models import FloorPlan
from robots.plans.floorplans import store_floor_plan
from robots.world.grid import encode_png
from robots.world.site_files import FloorPlanRefusedError, read_upload
from robots.world.sites import SHIPPED

pytestmark = pytest.mark.django_db
OFFICE = SHIPPED / "office"
YAML = (
    b"image: whatever.pgm\nresolution: 0.05\norigin: [-1.0, -2.0, 0.0]\nnegate: 0\noccupied_thresh:"
    b" 0.65\nfree_thresh: 0.196\n"
)
LAB = {"name": "lab", "title": "The lab"}


def store_upload(*files, **words):
    return FloorPlan.objects.create(**read_upload(*files, **words))


def image(width=30, height=20, value=254):
    return encode_png(np.full((height, width), value, dtype=np.uint8))


def test_storing_the_office_twice_replaces_it():
    first = store_floor_plan(OFFICE)
    again = store_floor_plan(OFFICE)
    assert first.pk == again.pk
    assert FloorPlan.objects.count() == 1
    kept = FloorPlan.objects.get(name="office")
    assert kept.plan["rooms"]
    assert kept.width > 100
    assert kept.sha256 == hashlib.sha256(bytes(kept.image)).hexdigest()


def test_floor_plan_message_contains_map_and_plan_without_translations():
    plan = store_floor_plan(OFFICE)
    message = decode("floorplan", encode(FloorPlan.objects.get().as_message()))
    assert message.map_id == "office"
    assert message.origin == (plan.origin_x, plan.origin_y, plan.origin_theta)
    assert hashlib.sha256(base64.b64decode(message.image)).hexdigest() == message.sha256
    # Translations are for pages only: agents of earlier versions refuse unknown fields.
    whole = floorplan.decode((OFFICE / "plan.json").read_bytes())
    sent = floorplan.decode(json.dumps(message.plan))
    assert sent == msgspec.structs.replace(whole, translations={})


def test_map_without_a_plan_is_stored_and_sent():
    plan = store_upload(YAML, image(), None, **LAB)
    assert (plan.width, plan.height, plan.resolution) == (30, 20, 0.05)
    assert (plan.origin_x, plan.origin_y, plan.plan) == (-1.0, -2.0, {})
    assert decode("floorplan", encode(plan.as_message())).plan is None


def test_pgm_of_map_saver_is_stored_as_png():
    pgm = b"P5\n# CREATOR: map_saver\n6 4\n255\n" + bytes([254] * 24)
    plan = store_upload(YAML, pgm, None, **LAB)
    assert (plan.width, plan.height) == (6, 4)
    assert bytes(plan.image).startswith(b"\x89PNG")


def test_image_path_in_the_yaml_is_not_read(tmp_path):
    secret = tmp_path / "secret.png"
    secret.write_bytes(image(width=7))
    yaml = YAML.replace(b"whatever.pgm", str(secret).encode())
    assert store_upload(yaml, image(width=30), None, **LAB).width == 30


@pytest.mark.parametrize(
    ("yaml", "picture", "plan", "word"),
    [
        (b"resolution: [", image(), None, "map.yaml"),
        (b"just words", image(), None, "map.yaml"),
        (b"- a\n- list", image(), None, "map.yaml"),
        (YAML.replace(b"0.05", b"-1"), image(), None, "resolution"),
        (YAML.replace(b"0.05", b".nan"), image(), None, "resolution"),
        (YAML.replace(b"0.05", b"50"), image(), None, "resolution"),
        (YAML.replace(b"-1.0", b".inf"), image(), None, "origin"),
        (YAML.replace(b"0.196", b"0.9"), image(), None, "thresh"),
        (YAML, b"GIF89a", None, "neither PNG nor PGM"),
        (YAML, b"\x89PNG\r\n\x1a\nbroken", None, "image"),
        (YAML, image(value=0), None, "no free cell"),
        (YAML, image(), b"{}", "plan.json"),
        (YAML, image(), b"\xff\xfe", "plan.json"),
    ],
    ids=map(str, range(13)),
)
def test_unusable_files_are_refused_and_change_nothing(yaml, picture, plan, word):
    with pytest.raises(FloorPlanRefusedError, match=word):
        store_upload(yaml, picture, plan, **LAB)
    assert not FloorPlan.objects.exists()


def test_image_too_large_for_a_message_is_refused():
    noise = np.random.default_rng(1).integers(0, 255, (900, 900), dtype=np.uint8)
    with pytest.raises(FloorPlanRefusedError, match="at most 512 kB"):
        store_upload(YAML, encode_png(noise), None, **LAB)


@pytest.mark.parametrize(
    ("name", "title"),
    [("", "The lab"), ("lab", ""), ("a b", "The lab"), ("x" * 51, "The lab"), ("lab", "x" * 121)],
)
def test_invalid_name_or_title_is_refused(name, title):
    with pytest.raises(FloorPlanRefusedError, match=r"map id|title"):
        store_upload(YAML, image(), None, name=name, title=title)
