"""The demo's study, for a visitor who only has its link."""

import pytest
from django.utils import timezone

from accounts.models import User
from experiments.models import Participant
from robots.models import Robot
from robots.plans.floorplans import store_floor_plan
from telepresence_site.demo.seed import RESEARCHER, seed
from telepresence_site.demo.study import publish_study
from tests.support.browsers.html_page import read
from tests.support.people import person
from tests.support.studies import participants as p
from tests.support.studies.study_pages import form_of
from tests.support.studies.study_site import robot_at

pytestmark = pytest.mark.django_db


def test_participant_follows_the_link_without_an_account(client):
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
    for language, text in (("en", "a simulated robot"), ("es", "un robot simulado")):
        client.cookies["django_language"] = language
        consent = read(client.get(f"/studies/{slug}/step/")).text
        assert text in consent
        assert "edificio real" not in consent
        assert "real building" not in consent
        assert "profile" not in consent, "guests have none"
    assert "simulated" in front.text
    assert publish_study(timezone.now()) == slug


def test_older_database_gets_the_marks_of_the_present_robots(settings, tmp_path):
    settings.VAR_DIR = tmp_path
    seed("mqtt://127.0.0.1:1")
    Robot.objects.update(for_experienced=False, description="Of an earlier version")
    seed("mqtt://127.0.0.1:1")
    marked = Robot.objects.order_by("name").values_list("name", "for_experienced")
    assert list(marked) == [("giraff", False), ("rhodon", True)]
    assert not Robot.objects.filter(description="Of an earlier version").exists()


def test_changes_of_an_owner_survive_the_next_start(client, settings, tmp_path):
    settings.VAR_DIR = tmp_path
    seed("mqtt://127.0.0.1:1")
    client.force_login(User.objects.get(username=RESEARCHER))
    robot = Robot.objects.get(name="rhodon")
    address = f"/admin/robots/robot/{robot.pk}/change/"
    form = form_of(client.get(address))
    form["description"] = "Our own words"
    del form["for_experienced"]
    answer = client.post(address, form)
    assert answer.status_code == 302, answer.context["errors"]
    seed("mqtt://127.0.0.1:1")
    robot.refresh_from_db()
    assert (robot.description, robot.for_experienced) == ("Our own words", False)
