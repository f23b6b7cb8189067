"""The demo's study, for somebody who only has its link."""

import pytest
from django.utils import timezone

from experiments.models import Participant
from robots.floorplans import store_floor_plan
from robots.models import Robot
from telepresence_site.demo.seed import RESEARCHER, seed
from telepresence_site.demo.study import publish_study
from tests.support.browsers.html_page import read
from tests.support.people import person
from tests.support.studies import participants as p
from tests.support.studies.study_site import robot_at

pytestmark = pytest.mark.django_db


def test_whoever_follows_the_link_takes_part_without_an_account(client):
    office = store_floor_plan(p.OFFICE)
    for series in ("giraff", "rhodon"):
        robot_at(office, series, series)
    person(RESEARCHER, is_staff=True, is_superuser=True)
    slug = publish_study(timezone.now())
    home = read(client.get("/"))
    assert f"/studies/{slug}/" in [link.attributes.get("href") for link in home.all("a")]
    front = read(client.get(f"/studies/{slug}/"))
    assert "You don't need an account or a name." in front.text
    assert "Sign up" not in front.text.partition("Take part")[2]
    assert "Write down this code." in read(client.post(f"/studies/{slug}/")).text
    assert Participant.objects.get().user.is_guest
    for language, is_told in (("en", "a simulated robot"), ("es", "un robot simulado")):
        client.cookies["django_language"] = language
        consent = read(client.get(f"/studies/{slug}/step/")).text
        assert is_told in consent
        assert "edificio real" not in consent
        assert "real building" not in consent
        assert "profile" not in consent, "guests have none"
    assert "simulated" in front.text
    assert publish_study(timezone.now()) == slug


def test_a_database_of_an_earlier_version_gets_the_marks_of_todays_robots(settings, tmp_path):
    settings.VAR_DIR = tmp_path
    seed("mqtt://127.0.0.1:1")
    Robot.objects.update(for_experienced=False)
    seed("mqtt://127.0.0.1:1")
    marked = Robot.objects.order_by("name").values_list("name", "for_experienced")
    assert list(marked) == [("giraff", False), ("rhodon", True)]
