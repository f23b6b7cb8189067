import datetime
import io

import pytest
from django.core.exceptions import BadRequest, PermissionDenied
from django.template.loader import render_to_string
from django.test import Client
from django.urls import path, reverse
from django.utils import timezone, translation
from PIL import Image

from robots.models import Robot, RobotPermit, RobotPresence
from sessions.models import Session
from telepresence_site.urls import urlpatterns as pages
from telepresence_site.web.pages import PER_PAGE
from tests.support.browsers.html_page import Page, faults, read
from tests.support.people import person
from tests.support.robots import create_robot, create_robots, unsaved_robot
from tests.support.sessions.rows import session_row

pytestmark = pytest.mark.django_db
RESET = [f"account_reset_password{step}" for step in ("", "_done", "_from_key_done")]
PUBLIC = [
    *("home", "about", "account_login", "account_signup", "account_email_verification_sent"),
    *("account_inactive", *RESET),
]
ACCOUNT = ("email", "change_password", "logout", "reauthenticate")
OWN = ["home", "profile", *(f"account_{page}" for page in ACCOUNT)]


def refuse(_request):
    raise PermissionDenied


def misread(_request):
    raise BadRequest


def break_down(_request):
    raise RuntimeError("of the test")


urlpatterns = [
    *pages,
    path("refuse/", refuse),
    path("misread/", misread),
    path("break/", break_down),
]


@pytest.fixture
def robots():
    now = timezone.now()
    here = {"connection": "ONLINE", "last_seen_at": now, "report": {"battery": {"charge": 0.5}}}
    earlier = {"last_seen_at": now - datetime.timedelta(hours=2)}
    made = {"giraff": here, "rhodon": here, "attic": earlier}
    return {
        name: create_robot(name=name, title=name.title(), **fields) for name, fields in made.items()
    }


def visit(robot: Robot, username: str, state: str) -> Session:
    return session_row(robot, person(username), state=state, seen_at=timezone.now())


def card_of(client, name: str) -> dict:
    return next(c for c in client.get(reverse("robots_json")).json()["robots"] if c["name"] == name)


@pytest.mark.parametrize("state", ["driving", "reconnecting"])
@pytest.mark.parametrize(
    ("language", "said"),
    [
        ("en", ("You are driving it", "Back to your drive")),
        ("es", ("Lo estás conduciendo", "Volver a tu conducción")),
    ],
)
def test_landing_page_leads_a_driver_back_to_the_robot(client, robots, state, language, said):
    own = visit(robots["rhodon"], "driver", state)
    visit(robots["rhodon"], "second", "waiting")
    client.force_login(own.visitor)
    answer = client.get(reverse("robots_json"), headers={"accept-language": language}).json()
    card = next(one for one in answer["robots"] if one["name"] == "rhodon")
    assert (card["label"], card["action"]) == said
    assert answer["invitation"] == {"label": said[1], "url": card["url"]}
    page = read(client.get(reverse("home"), headers={"accept-language": language}))
    assert said[0] in page.text
    client.force_login(person("somebody"))
    assert card_of(client, "rhodon")["action"] == "Join the queue"


@pytest.mark.parametrize(
    ("language", "said"),
    [
        ("en", ("You are number 2 in the queue", "Back to the queue")),
        ("es", ("Tienes el número 2 en la cola", "Volver a la cola")),
    ],
)
def test_landing_page_shows_a_queued_visitor_their_place(client, robots, language, said):
    visit(robots["rhodon"], "driver", "driving")
    visit(robots["rhodon"], "first", "waiting")
    second = visit(robots["rhodon"], "second", "waiting")
    visit(robots["rhodon"], "third", "waiting")
    client.force_login(second.visitor)
    answer = client.get(reverse("robots_json"), headers={"accept-language": language}).json()
    card = next(one for one in answer["robots"] if one["name"] == "rhodon")
    assert card["detail"].startswith(said[0])
    assert card["action"] == said[1]
    assert answer["invitation"] == {"label": said[1], "url": card["url"]}
    client.force_login(person("somebody"))
    assert card_of(client, "rhodon")["detail"].startswith("You'd be number 4 in the queue")


@pytest.mark.parametrize("language", ["en", "es"])
@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_page_is_valid_in_both_languages(client, robots, name, language):
    response = client.get(reverse(name), headers={"accept-language": language})
    page = read(response)
    assert response.status_code == 200
    assert page.all("html")[0].attributes["lang"] == language
    assert faults(page) == []
    assert {"en": "Skip to the content", "es": "Saltar al contenido"}[language] in page.text


@pytest.mark.parametrize("language", ["en", "es"])
@pytest.mark.parametrize("name", OWN)
def test_every_page_of_a_visitor_is_valid_in_both_languages(client, robots, name, language):
    client.force_login(person(email="ada@example.org"))
    response = client.get(reverse(name), headers={"accept-language": language}, follow=True)
    assert response.status_code == 200
    assert faults(read(response)) == []


def test_language_switch_returns_to_the_page(client):
    response = client.post(reverse("set_language"), {"language": "es", "next": reverse("about")})
    assert response.url == reverse("about")
    page = read(client.get(reverse("about")))
    assert "Qué registramos" in page.text
    assert reverse("own_data") in [link.attributes.get("href") for link in page.all("a")]


def test_landing_page_shows_each_robot_with_its_state_and_one_button(client, robots):
    visit(robots["rhodon"], "driver", "driving")
    visit(robots["rhodon"], "second", "waiting")
    page = read(client.get(reverse("home")))
    cards = {e.attributes["data-robot"]: e for e in page.all("article")}
    assert list(cards) == ["giraff", "rhodon", "attic"]
    assert [c.attributes["data-state"] for c in cards.values()] == ["available", "busy", "offline"]
    assert "Free now" in cards["giraff"].text
    assert "50 %" in cards["giraff"].text
    assert "You'd be number 2 in the queue, with a wait of about " in cards["rhodon"].text
    assert "Last seen 2" in cards["attic"].text


def test_landing_page_shows_titles_and_descriptions_in_its_language(client, robots):
    giraff = robots["giraff"]
    giraff.description = "A slender robot."
    giraff.translations = {"es": {"title": "Jirafa", "description": "Un robot esbelto."}}
    giraff.save()
    for language, said in (
        ("en", ("Giraff", "A slender robot.")),
        ("es", ("Jirafa", "Un robot esbelto.")),
    ):
        page = read(client.get(reverse("home"), headers={"accept-language": language}))
        card = next(e for e in page.all("article") if e.attributes["data-robot"] == "giraff")
        assert all(words in card.text for words in said), card.text


@pytest.mark.parametrize("state", ["connecting", "driving", "reconnecting"])
def test_robot_is_in_use_from_the_grant_to_the_end(client, robots, state):
    session = visit(robots["giraff"], "driver", state)
    assert card_of(client, "giraff")["state"] == "busy"
    Session.objects.filter(pk=session.pk).update(state="ended")
    assert card_of(client, "giraff")["state"] == "available"


def test_sign_up_leads_a_new_visitor_to_the_robot(client, robots):
    assert card_of(client, "giraff")["url"] == "/accounts/signup/?next=%2Frobots%2Fgiraff%2F"
    assert card_of(client, "attic")["url"] == "/accounts/signup/?next=%2Frobots%2Fattic%2F"


def test_button_of_a_robot_leads_a_visitor_to_driving_it(client, robots):
    client.force_login(person())
    assert card_of(client, "giraff")["url"] == "/robots/giraff/?go=1"
    assert card_of(client, "attic")["url"] == "/robots/attic/"
    assert client.get(reverse("home")).context["invitation"].label == "Drive Giraff"


def test_first_button_prefers_a_robot_for_beginners_even_if_it_is_in_use(client, robots):
    def shown():
        return client.get(reverse("home")).context

    Robot.objects.filter(name="rhodon").update(for_experienced=True, title="A rhodon")
    client.force_login(person())
    for state, label in (("available", "Drive Giraff"), ("busy", "Join the queue")):
        if state == "busy":
            visit(robots["giraff"], "driver", "driving")
        invitation = shown()["invitation"]
        assert (invitation.label, invitation.url) == (label, "/robots/giraff/?go=1")
        assert [card.name for card in shown()["cards"]] == ["giraff", "rhodon", "attic"]
    page = read(client.get(reverse("home")))
    texts = {e.attributes["data-robot"]: e.text for e in page.all("article")}
    assert "For experienced drivers." in texts["rhodon"]
    assert "For experienced drivers." not in texts["giraff"]
    RobotPresence.objects.filter(robot__name="giraff").update(connection="OFFLINE")
    assert shown()["invitation"].url == "#robots"


def test_first_button_prefers_such_a_robot_for_experienced_visitors_too(client, robots):
    Robot.objects.filter(name="rhodon").update(for_experienced=True)
    visit(robots["giraff"], "driver", "driving")
    driven = visit(robots["rhodon"], "ada", "ended")
    Session.objects.filter(pk=driven.pk).update(first_motion_at=timezone.now())
    client.force_login(driven.visitor)
    assert client.get(reverse("home")).context["invitation"].url == "/robots/giraff/?go=1"


def test_robots_by_invitation_are_shown_only_to_invited_visitors(client, robots):
    Robot.objects.filter(name="rhodon").update(access=Robot.Access.INVITATION)
    assert "Rhodon" not in read(client.get(reverse("home"))).text
    user = person()
    kind = RobotPermit.Privilege.INVITED
    RobotPermit.objects.create(robot=robots["rhodon"], user=user, kind=kind)
    client.force_login(user)
    assert card_of(client, "rhodon")["drives"]


def test_list_of_robots_has_no_other_fields(client, robots):
    shown = ("title", "description", "place", "picture", "badge", "label", "detail", "battery")
    states = ("name", "state", "charge", "action", "drives", "for_experienced", "own", "url")
    assert set(card_of(client, "giraff")) == {*shown, *states}


def test_list_of_robots_is_not_cached_and_uses_the_visitors_language(client, robots):
    response = client.get(reverse("robots_json"), headers={"accept-language": "es"})
    assert "no-store" in response["Cache-Control"]
    assert response.json()["robots"][0]["label"] == "Libre ahora"


@pytest.mark.parametrize("count", [1, 12])
def test_list_needs_as_many_queries_for_many_robots_as_for_one(
    client, django_assert_max_num_queries, count
):
    for n in range(count):
        Robot.objects.create(name=f"robot-{n}", title=f"Robot {n}")
    with django_assert_max_num_queries(2):
        client.get(reverse("robots_json"))


def many_robots(count: int, **fields) -> None:
    create_robots(
        *(unsaved_robot(name=f"many-{n:04}", title=f"Many {n:04}", **fields) for n in range(count))
    )


@pytest.mark.parametrize("count", [30, 300])
def test_page_of_many_invitations_needs_as_many_queries_as_one_of_few(
    client, django_assert_max_num_queries, count
):
    user = person("invited")
    many_robots(count, access=Robot.Access.INVITATION)
    invited = Robot.objects.filter(access=Robot.Access.INVITATION)
    RobotPermit.objects.bulk_create(
        RobotPermit(robot=robot, user=user, kind=RobotPermit.Privilege.INVITED) for robot in invited
    )
    client.force_login(user)
    with django_assert_max_num_queries(8):
        shown = client.get(reverse("robots_json")).json()["robots"]
    assert len(shown) == PER_PAGE


def test_many_robots_are_paginated_with_online_ones_first(client):
    many_robots(60)
    RobotPresence.objects.filter(robot__name="many-0059").update(
        connection="ONLINE", last_seen_at=timezone.now()
    )
    first = client.get(reverse("home"))
    assert first.context["cards"][0].name == "many-0059"
    assert "Page 1 of 3" in read(first).text
    names = [
        card["name"]
        for page in ("1", "2", "3")
        for card in client.get(reverse("robots_json"), {"page": page}).json()["robots"]
    ]
    assert len(names) == len(set(names)) == 60
    for nearest in ("9", "99999999999999999999", "-1", "x"):
        assert client.get(reverse("home"), {"page": nearest}).status_code == 200


def test_robots_are_found_by_words_of_title_and_description(client):
    many_robots(60)
    Robot.objects.create(name="giraff", title="Giraff", description="In the museum of Málaga")
    found = client.get(reverse("home"), {"q": "museum gir"})
    assert [card.name for card in found.context["cards"]] == ["giraff"]
    nothing = client.get(reverse("home"), {"q": "museum 0001"})
    assert "No robot matches your search." in read(nothing).text


def test_site_without_robots_explains_it(client):
    response = client.get(reverse("home"))
    assert "No robots yet" in read(response).text
    assert response.context["invitation"].url == "#robots"


def test_titles_and_descriptions_are_shown_as_text(client):
    Robot.objects.create(
        name="giraff", title="<b>Giraff</b>", description="<script>alert(1)</script>"
    )
    html = client.get(reverse("home")).content.decode()
    assert "<b>Giraff" not in html
    assert "<script>alert" not in html


@pytest.mark.parametrize("name", ["home", "robots_json", "about", "manifest"])
def test_read_only_pages_refuse_post(client, name):
    assert client.post(reverse(name)).status_code == 405


def test_manifest_names_existing_icons(client):
    response = client.get(reverse("manifest"))
    manifest = response.json()
    assert response["Content-Type"] == "application/manifest+json"
    assert {icon["purpose"] for icon in manifest["icons"]} == {"any", "maskable"}
    assert manifest["start_url"] == "/"
    for icon in manifest["icons"]:
        assert client.get(icon["src"]).status_code == 200, icon["src"]


def test_manifest_describes_the_installed_page_with_pictures_of_true_size(client):
    manifest = client.get(reverse("manifest")).json()
    installed = {"id": "/", "scope": "/", "display": "standalone", "orientation": "any"}
    assert installed.items() <= manifest.items()
    for shortcut in manifest["shortcuts"]:
        assert client.get(shortcut["url"].split("#")[0]).status_code == 200
    assert {picture["form_factor"] for picture in manifest["screenshots"]} == {"wide", "narrow"}
    for picture in manifest["screenshots"]:
        content = b"".join(client.get(picture["src"]).streaming_content)
        with Image.open(io.BytesIO(content)) as image:
            assert (f"{image.width}x{image.height}", image.format) == (picture["sizes"], "WEBP")


@pytest.mark.urls(__name__)
@pytest.mark.parametrize(
    ("address", "code", "words"),
    [
        ("/misread/", 400, "We couldn't process that"),
        ("/refuse/", 403, "You don't have access"),
        ("/nowhere/", 404, "Page not found"),
        ("/break/", 500, "Something went wrong on our side"),
    ],
)
def test_error_page_explains_what_to_do(address, code, words):
    response = Client(raise_request_exception=False).get(address)
    page = read(response)
    assert response.status_code == code
    assert words in page.text
    assert any(e.attributes.get("href") == "/" for e in page.all("a"))
    assert faults(page) == []


@pytest.mark.parametrize("address", ["/robots/nowhere/", "/nowhere/"])
def test_error_page_keeps_the_menu_of_a_visitor_who_is_logged_in(address):
    client = Client(raise_request_exception=False)
    client.force_login(person("ada"))
    page = read(client.get(address))
    assert "Log out" in page.text
    assert faults(page) == []


@pytest.mark.parametrize("language", ["en", "es"])
@pytest.mark.parametrize("name", ["400", "403", "403_csrf", "404", "429", "500"])
def test_error_page_needs_no_context_no_database_and_no_collected_files(
    name, language, settings, django_assert_num_queries
):
    hashed = {"BACKEND": "telepresence_site.web.static_files.HashedModules"}
    settings.STORAGES = settings.STORAGES | {"staticfiles": hashed}
    with translation.override(language), django_assert_num_queries(0):
        page = Page()
        page.feed(render_to_string(f"{name}.html"))
    assert faults(page) == []
    assert page.all("html")[0].attributes["lang"] == language
