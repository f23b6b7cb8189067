"""The drive page, and a visitor's snapshots."""

import datetime
import json
import re
from html import unescape

import pytest
from django.contrib.auth import get_user_model
from django.urls import reverse
from django.utils import timezone

from robots.api.reasons import ReasonCode
from robots.models import Robot, RobotPermit
from sessions.models import Snapshot
from tests.support.robots import create_robot, floor_plan
from tests.support.sessions import replays
from tests.support.sessions.rows import session_row

pytestmark = pytest.mark.django_db


@pytest.fixture
def robot():
    plan, factsheet = floor_plan("office", sha256="a" * 64), {"name": "giraff"}
    return create_robot(floor_plan=plan, turn_minutes=2.0, factsheet=factsheet)


@pytest.fixture
def ada():
    return get_user_model().objects.create_user("ada", display_name="Ada L.", password="x")


def config_of(response):
    script = r'<script id="config" type="application/json"[^>]*>(.*?)</script>'
    return json.loads(re.search(script, response.content.decode(), re.DOTALL)[1])


def snapshot_of(visitor, robot):
    image = {"sha256": "b" * 64, "jpeg": b"\xff\xd8jpeg"}
    session = session_row(robot, visitor)
    return Snapshot.objects.create(session=session, action_id="p1", stamp=5.0, **image)


def test_drive_page_redirects_to_the_login_and_back(client, robot):
    response = client.get("/robots/giraff/")
    assert response.status_code == 302
    assert response.url == f"{reverse('account_login')}?next=/robots/giraff/"


def test_drive_page_contains_its_configuration(client, robot, ada):
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


def test_only_operators_read_which_part_of_the_server_fails(client, robot, ada):
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


def test_title_of_a_robot_is_escaped(client, robot, ada):
    Robot.objects.update(title="</script><script>alert(1)</script>")
    client.force_login(ada)
    response = client.get("/robots/giraff/")
    assert b"<script>alert" not in response.content
    assert config_of(response)["title"] == "</script><script>alert(1)</script>"


def test_unknown_or_invisible_robot_has_no_page(client, robot, ada):
    client.force_login(ada)
    assert client.get("/robots/unknown/").status_code == 404
    Robot.objects.update(access=Robot.Access.INVITATION)
    assert client.get("/robots/giraff/").status_code == 404


def test_invited_visitor_may_not_open_a_robot_for_trained_users(client, robot, ada):
    Robot.objects.update(access=Robot.Access.TRAINED)
    RobotPermit.objects.create(robot=robot, user=ada, kind=RobotPermit.Privilege.INVITED)
    client.force_login(ada)
    assert client.get("/robots/giraff/").status_code == 403


def test_visitor_sees_only_their_own_snapshots(client, robot, ada, bob):
    own, other = snapshot_of(ada, robot), snapshot_of(bob, robot)
    client.force_login(ada)
    (listed,) = client.get("/robots/giraff/snapshots/").json()["snapshots"]
    assert (listed["actionId"], listed["session"]) == ("p1", str(own.session_id))
    picture = client.get(listed["url"])
    assert (picture.content, picture["Content-Type"]) == (b"\xff\xd8jpeg", "image/jpeg")
    assert "private" in picture["Cache-Control"]
    assert client.get(f"/robots/giraff/snapshots/{other.pk}.jpg").status_code == 404


def test_snapshots_need_a_login(client, robot, ada):
    own = snapshot_of(ada, robot)
    for address in ("/robots/giraff/snapshots/", f"/robots/giraff/snapshots/{own.pk}.jpg"):
        assert client.get(address).status_code == 302


@pytest.mark.parametrize("address", ["/robots/giraff/", "/robots/giraff/snapshots/"])
def test_pages_refuse_post_requests(client, robot, ada, address):
    client.force_login(ada)
    assert client.post(address).status_code == 405


def test_visitor_reads_own_visits_with_their_photos_newest_first(client, robot, ada):
    zaphod = get_user_model().objects.create_user("zaphod")
    at = replays.GRANTED
    first = replays.session(robot, ada, seconds=90)
    newest = replays.session(robot, ada, granted=at + datetime.timedelta(days=1), seconds=30)
    session_row(robot, ada, driving_at=None, live_key="queued only")
    others = replays.session(robot, zaphod, seconds=60)
    image = {"stamp": 5.0, "sha256": "b" * 64, "jpeg": b"\xff\xd8jpeg"}
    mine, theirs = (
        Snapshot.objects.create(session=session, action_id="p", **image)
        for session in (first, others)
    )
    practice = create_robot("practice-1", practice=True)
    replays.session(practice, ada, granted=at + datetime.timedelta(days=2), seconds=60)
    assert client.get(reverse("my_visits")).status_code == 302
    client.force_login(ada)
    text = unescape(client.get(reverse("my_visits")).content.decode())
    assert re.findall(r'id="visit-(.*?)"', text) == [str(newest.pk), str(first.pk)]
    assert "1.5 min" in text
    photo = re.search(r'<img src="(/robots/giraff/[^"]*)"', text)[1]
    assert str(mine.pk) in photo
    assert str(theirs.pk) not in text
    assert client.get(photo).status_code == 200
    mine.delete()  # `manage.py forget`
    assert str(mine.pk) not in client.get(reverse("my_visits")).content.decode()


def test_home_page_of_a_user_begins_with_the_robots(client, ada):
    create_robot(connection="ONLINE", last_seen_at=timezone.now())
    assert "Be there," in client.get("/").content.decode()
    client.force_login(ada)
    text = client.get("/").content.decode()
    assert "Be there," not in text.split("<main", 1)[1]
    button = re.search(r"data-invitation>(.*?)</p>", text, re.DOTALL)[1]
    assert "Drive Giraff" in button
    assert 'href="/robots/giraff/?go=1"' in button
