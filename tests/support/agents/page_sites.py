"""A site made from a map on the administration's pages, by Django's test client."""

from pathlib import Path

import yaml
from django.conf import settings
from django.test import Client

from robots.models import FloorPlan
from tests.support.browsers.html_page import read
from tests.support.studies.study_pages import form_of

ADD = "/admin/robots/floorplan/add/"


def site_by_page(client: Client, map_file: Path, name: str, occupied: str = "") -> Path:
    """Return the folder of the site that the pages make of a map for a signed-in member of staff;
    `occupied` is what is typed as the least occupancy of a wall.

    Nothing of the proposal is changed. AssertionError with what a page says when it refuses.
    """
    image = map_file.parent / yaml.safe_load(map_file.read_text())["image"]
    with map_file.open("rb") as about, image.open("rb") as picture:
        sent = {"map_file": about, "image_file": picture, "name": name, "title": name}
        answer = client.post(ADD, sent)
    assert answer.status_code == 302, _said(answer)
    page = f"/admin/robots/floorplan/{FloorPlan.objects.get(name=name).pk}/finish/"
    form = form_of(client.get(page))
    if occupied:
        form["occupied_thresh"] = occupied
    for action in ("propose", "save"):
        form["action"] = action
        answer = client.post(page, form)
        assert answer.status_code == 302, _said(answer)
        form = form_of(client.get(page))
    return Path(settings.VAR_DIR) / "sites" / name


def _said(response: object) -> str:
    page = read(response)
    return "; ".join(e.text for e in page.all("li") if e.text.strip().endswith("."))
