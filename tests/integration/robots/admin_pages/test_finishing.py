"""The page that finishes a floor plan, without its script."""

import json

import numpy as np
import pytest
from django.contrib.auth.models import Permission
from django.urls import reverse

from accounts.models import AuditEntry
from robots.api import floorplan
from robots.models import FloorPlan, Robot
from robots.plans.drafts import grid_of, propose, store_site
from robots.world.grid import encode_png
from robots.world.inspection import inspect_site
from robots.world.site_files import read_upload
from robots.world.sites import load_site
from tests.support.agents.mapped_building import building, mapped
from tests.support.browsers.html_page import Page
from tests.support.people import person

pytestmark = pytest.mark.django_db
UNSENT = ("checkbox", "radio")  # none of which is checked or needed here
YAML = b"image: m.png\nresolution: 0.05\norigin: [-1.6, -1.6, 0.0]\nnegate: 0\n"


@pytest.fixture(autouse=True)
def var(settings, tmp_path):
    settings.VAR_DIR = tmp_path / "var"
    return settings.VAR_DIR


@pytest.fixture
def staff(client):
    user = person("planner", is_staff=True)
    wanted = Permission.objects.filter(codename__in=("view_floorplan", "change_floorplan"))
    user.user_permissions.set(wanted)
    client.force_login(user)
    return user


@pytest.fixture(scope="module")
def proposed():
    """The proposed plan of a mapped hall, and its map."""
    grid = mapped(building(furnished=True), np.random.default_rng(2))
    return propose(grid, "hall", "Hall"), grid


@pytest.fixture
def row(staff, proposed):
    return store_site(*proposed)[0]


def page_of(row: FloorPlan) -> str:
    return reverse("admin:robots_floorplan_finish", args=[row.pk])


def shown(response) -> Page:
    page = Page()
    page.feed(response.content.decode())
    return page


def fields(response) -> dict[str, str]:
    """Return the values that a browser would send."""
    page, result, select = shown(response), {}, ""
    for element in page.elements:
        name = element.attributes.get("name", "")
        if element.tag == "select":
            select = name
        elif element.tag == "option":
            if select not in result or "selected" in element.attributes:
                result[select] = element.attributes["value"]
        elif element.tag == "input" and element.attributes.get("type") not in UNSENT:
            result[name] = element.attributes.get("value", "")
    return {name: value for name, value in result.items() if name}


def send(client, row: FloorPlan, action: str, before=None, **changes: str):
    values = fields(before or client.get(page_of(row)))
    return client.post(page_of(row), values | changes | {"action": action})


def test_plan_is_proposed_for_a_map_without_one(client, staff):
    grid = mapped(building(), np.random.default_rng(3))
    row = FloorPlan.objects.create(
        **read_upload(YAML, encode_png(grid.image), None, name="bare", title="Bare")
    )
    assert "Propose a plan" in client.get(page_of(row)).content.decode()
    response = client.post(page_of(row), {"action": "propose", "occupied_thresh": "0.65"})
    assert response.status_code == 302
    row.refresh_from_db()
    assert len(row.plan["rooms"]) == 3
    assert row.title == "Bare"
    assert client.get(page_of(row)).status_code == 200
    assert AuditEntry.objects.filter(act="plan_proposed").count() == 1


def test_map_without_a_proposal_shows_the_reason(client, staff):
    image = encode_png(np.full((200, 200), 254, dtype=np.uint8))
    row = FloorPlan.objects.create(**read_upload(YAML, image, None, name="bare", title="Bare"))
    text = client.post(page_of(row), {"action": "propose"}).content.decode()
    assert "t propose a plan:" in text
    assert "The map shows 0 walls" in text


def test_names_and_a_door_are_saved_for_pages_robots_and_simulators(client, row, var):
    changes = {"rooms.0.title": "Laboratory", "openings.0.kind": "door"}
    assert send(client, row, "save", **changes).status_code == 302
    row.refresh_from_db()
    assert row.plan["rooms"][0]["title"] == "Laboratory"
    assert len(row.plan["doors"]) == 1
    plan = floorplan.decode(json.dumps(row.plan))
    assert inspect_site(plan, grid_of(row)) == ()
    assert load_site(str(var / "sites" / "hall")).plan == plan
    assert row.as_message().plan == row.plan
    assert AuditEntry.objects.filter(act="plan_finished").count() == 1


@pytest.mark.parametrize("kind", ["place", "dock", "checkpoint", "opening"])
def test_added_part_is_shown_but_not_stored_before_it_is_saved(client, row, kind):
    before, plan = fields(client.get(page_of(row))), row.plan
    response = send(client, row, kind, at_x="2.0", at_y="3.0")
    after = fields(response)
    assert len(after) > len(before)
    assert "Not saved yet." in response.content.decode()
    row.refresh_from_db()
    assert row.plan == plan


def test_checkpoints_are_added_one_after_another_and_saved(client, row):
    response = send(client, row, "checkpoint", at_x="2.0", at_y="3.0")
    response = send(client, row, "checkpoint", response, at_x="6.0", at_y="1.0")
    assert send(client, row, "save", response).status_code == 302
    row.refresh_from_db()
    numbers = [c["number"] for c in row.plan["routes"][0]["checkpoints"]]
    assert numbers == [0, 1, 2]


def test_impossible_plan_is_reported_and_kept_on_the_page_but_not_stored(client, row):
    before = row.plan
    for action in ("check", "save"):
        response = send(
            client, row, action, **{"docks.0.x": "50", "docks.0.y": "50", "rooms.0.title": "Mine"}
        )
        text = response.content.decode()
        assert "is not in a room" in text
        assert fields(response)["rooms.0.title"] == "Mine"
        row.refresh_from_db()
        assert row.plan == before


@pytest.mark.parametrize("text", ["north", "nan", "", "1e99"])
def test_invalid_number_is_reported(client, row, text):
    response = send(client, row, "save", **{"docks.0.x": text})
    assert "is not a valid number here" in response.content.decode()


@pytest.mark.parametrize(
    ("action", "sent", "status"),
    [("save", {}, 302), ("explode", {"rooms.0.title": "X"}, 200)]
    + [("save", {"draft": draft}, 302) for draft in ("", "{", "[]", '{"rooms": 7}', "null")],
)
def test_saving_no_change_malformed_drafts_and_unknown_actions_store_nothing(
    client, row, action, sent, status
):
    before = row.plan
    for _ in range(2):
        assert send(client, row, action, **sent).status_code == status
        row.refresh_from_db()
        assert row.plan == before


def test_owner_who_may_only_view_the_plan_cannot_open_the_page(client, row):
    owner = person("owner", is_staff=True)
    Robot.objects.create(name="r1", title="R", owner=owner, floor_plan=row)
    client.force_login(owner)
    change = client.get(reverse("admin:robots_floorplan_change", args=[row.pk]))
    assert change.status_code == 200
    assert page_of(row) not in change.content.decode()
    assert client.get(page_of(row)).status_code == 403
    assert client.post(page_of(row), {"action": "save"}).status_code == 403
    client.logout()
    assert client.get(page_of(row)).status_code == 302


def test_missing_plan_is_not_found(client, row):
    address = page_of(row)
    FloorPlan.objects.all().delete()
    assert client.get(address).status_code == 404


def test_plans_page_links_to_the_finishing_page(client, row):
    change = client.get(reverse("admin:robots_floorplan_change", args=[row.pk]))
    assert page_of(row) in change.content.decode()
    page = shown(client.get(page_of(row)))
    assert page.open == []
    assert not [e for e in page.elements if "style" in e.attributes]
