"""The drive page, and a visitor's own snapshots."""

import json
import re
from html import unescape

import pytest
from django.contrib.auth import get_user_model
from django.urls import reverse
from django.utils import timezone

from robots.api.reasons import ReasonCode
from robots.models import FloorPlan, Robot, RobotPermit
from sessions.models import Session, Snapshot
from tests.support.robots import create_robot
from tests.support.sessions.memory_bridge import MemoryBridge

pytestmark = pytest.mark.django_db


@pytest.fixture
def robot():
    plan = FloorPlan.objects.create(
        name="office",
        title="Office",
        resolution=0.05,
        origin_x=0.0,
        origin_y=0.0,
        width=1,
        height=1,
        image=b"png",
        sha256="a" * 64,
    )
    return create_robot(
        name="giraff",
        title="Giraff",
        floor_plan=plan,
        turn_minutes=2.0,
        factsheet={"name": "giraff"},
    )


@pytest.fixture
def ada():
    return get_user_model().objects.create_user("ada", display_name="Ada L.", password="x")


def config_of(response):
    return json.loads(
        re.search(
            r'<script id="config" type="application/json"[^>]*>(.*?)</script>',
            response.content.decode(),
            re.DOTALL,
        ).group(1)
    )


def snapshot_of(visitor, robot):
    session = Session.objects.create(
        robot=robot, visitor=visitor, live_key=f"{visitor}", queued_at=timezone.now()
    )
    return Snapshot.objects.create(
        session=session, action_id="p1", stamp=5.0, sha256="b" * 64, jpeg=b"\xff\xd8jpeg"
    )


def test_the_drive_page_asks_visitors_to_sign_in_and_brings_them_back(client, robot):
    response = client.get("/robots/giraff/")
    assert response.status_code == 302
    assert response.url == f"{reverse('account_login')}?next=/robots/giraff/"


def test_the_drive_page_tells_its_modules_where_everything_is(client, robot, ada):
    client.force_login(ada)
    response = client.get("/robots/giraff/")
    assert response.status_code == 200
    config = config_of(response)
    assert config["socket"] == "/ws/robots/giraff/"
    assert config["floorplan"] == "/floorplans/office.json"
    assert config["who"] == "Ada L."
    assert config["factsheet"] == {"name": "giraff"}
    assert "no-store" in response["Cache-Control"]


def test_drive_page_has_a_translated_sentence_for_each_reason(client, robot, ada):
    client.force_login(ada)
    texts = {}
    for language in ("en", "es"):
        client.cookies["django_language"] = language
        page = unescape(client.get("/robots/giraff/").content.decode())
        texts[language] = dict(re.findall(r'data-word="reason\.(\w+)">(.*?)</p>', page))
    with_sentence = {code: code.sentence for code in ReasonCode if code.sentence}
    assert texts["en"].items() >= with_sentence.items()
    assert texts["es"]["boxed_in"] == "No tiene sitio para moverse."


def test_only_who_operates_the_robot_reads_which_part_of_the_server_fails(client, robot, ada):
    def faults():
        text = unescape(client.get("/robots/giraff/").content.decode())
        return " ".join(re.findall(r'data-word="fault\.(?!robot\.)[^"]*">(.*?)</p>', text))

    parts = re.compile("service|database|disk|broker|manager")
    client.force_login(ada)
    assert faults().count("The server has a problem.") == 14
    assert not parts.search(faults())
    RobotPermit.objects.create(robot=robot, user=ada, kind=RobotPermit.Privilege.OPERATOR)
    assert "The server's control service isn't responding." in faults()
    assert "The server has a problem." not in faults()


def test_a_robots_title_cannot_break_out_of_the_page(client, robot, ada):
    Robot.objects.update(title="</script><script>alert(1)</script>")
    client.force_login(ada)
    response = client.get("/robots/giraff/")
    assert b"<script>alert" not in response.content
    assert config_of(response)["title"] == "</script><script>alert(1)</script>"


def test_there_is_no_page_for_an_unknown_robot_or_one_that_is_not_shown(client, robot, ada):
    client.force_login(ada)
    assert client.get("/robots/nobody/").status_code == 404
    Robot.objects.update(access=Robot.Access.INVITATION)
    assert client.get("/robots/giraff/").status_code == 404


def test_a_visitor_who_was_invited_to_a_robot_for_trained_users_is_told_no(client, robot, ada):
    Robot.objects.update(access=Robot.Access.TRAINED)
    RobotPermit.objects.create(robot=robot, user=ada, kind=RobotPermit.Privilege.INVITED)
    client.force_login(ada)
    assert client.get("/robots/giraff/").status_code == 403


def test_a_visitor_sees_own_snapshots_and_nobody_elses(client, robot, ada, bob):
    own, other = snapshot_of(ada, robot), snapshot_of(bob, robot)
    client.force_login(ada)
    (listed,) = client.get("/robots/giraff/snapshots/").json()["snapshots"]
    assert (listed["actionId"], listed["session"]) == ("p1", str(own.session_id))
    picture = client.get(listed["url"])
    assert (picture.content, picture["Content-Type"]) == (b"\xff\xd8jpeg", "image/jpeg")
    assert "private" in picture["Cache-Control"]
    assert client.get(f"/robots/giraff/snapshots/{other.pk}.jpg").status_code == 404


def test_snapshots_are_for_who_has_signed_in(client, robot, ada):
    own = snapshot_of(ada, robot)
    for address in ("/robots/giraff/snapshots/", f"/robots/giraff/snapshots/{own.pk}.jpg"):
        assert client.get(address).status_code == 302


@pytest.mark.parametrize("address", ["/robots/giraff/", "/robots/giraff/snapshots/"])
def test_pages_that_show_change_nothing(client, robot, ada, address):
    client.force_login(ada)
    assert client.post(address).status_code == 405
