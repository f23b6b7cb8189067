import pytest
from django.urls import reverse

from accounts.models import User
from tests.support.browsers.html_page import faults, read
from tests.support.people import PASSWORD, person

pytestmark = pytest.mark.django_db
NAMES = {"username": "ada", "display_name": "Ada Lovelace", "email": "Ada@Example.org"}
FORM = NAMES | {"password1": PASSWORD}


def sign_up(client, **changes):
    return client.post(reverse("account_signup"), FORM | changes)


def test_a_visitor_signs_up_with_one_form_and_is_signed_in(client):
    response = sign_up(client)
    assert response.status_code == 302
    assert response.url == reverse("home")
    user = User.objects.get(username="ada")
    assert user.display_name == user.shown_name == "Ada Lovelace"
    assert user.email == "ada@example.org"
    assert client.get(reverse("home")).context["user"] == user


def test_sign_up_leads_on_to_the_robot_that_was_asked_for(client):
    assert sign_up(client, next="/robots/giraff/").url == "/robots/giraff/"


def test_sign_up_leads_to_no_other_site(client):
    assert sign_up(client, next="https://elsewhere.example/").url == reverse("home")


def test_an_account_needs_neither_an_e_mail_address_nor_a_shown_name(client):
    assert sign_up(client, email="", display_name="").status_code == 302
    assert User.objects.get(username="ada").shown_name == "ada"


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"username": ""}, "username"),
        ({"username": "a b"}, "username"),
        ({"username": "<script>"}, "username"),
        ({"username": "x" * 151}, "username"),
        ({"email": "not an address"}, "email"),
        ({"password1": "short"}, "password1"),
        ({"password1": "password1234"}, "password1"),
        ({"password1": ""}, "password1"),
        ({"display_name": "x" * 61}, "display_name"),
        ({"display_name": "\u202eadA"}, "display_name"),
    ],
)
def test_a_wrong_field_is_named_and_its_error_is_tied_to_it(client, change, field):
    response = sign_up(client, **change)
    assert response.status_code == 200
    assert list(response.context["form"].errors) == [field]
    assert not User.objects.exists()
    page = read(response)
    control = next(e for e in page.all("input") if e.attributes.get("name") == field)
    assert control.attributes["aria-invalid"] == "true"
    error = next(e for e in page.elements if e.attributes.get("id") == f"id_{field}_error")
    assert error.text.strip()
    assert f"id_{field}_error" in control.attributes["aria-describedby"].split()
    assert any(e.attributes.get("role") == "alert" for e in page.elements)
    assert faults(page) == []


def test_a_refused_form_keeps_its_values_but_the_password(client):
    page = read(sign_up(client, username="a b"))
    values = {e.attributes.get("name"): e.attributes.get("value") for e in page.all("input")}
    assert values["username"] == "a b"
    assert values["display_name"] == "Ada Lovelace"
    assert values["password1"] is None


def test_a_user_name_that_is_taken_is_refused_in_any_spelling(client):
    person("ada")
    assert sign_up(client, username="ADA").status_code == 200
    assert User.objects.count() == 1


def test_a_second_account_with_the_same_address_is_not_made(client):
    person("first", email="ada@example.org")
    sign_up(client)
    assert User.objects.count() == 1


def test_blanks_of_a_shown_name_are_tidied(client):
    sign_up(client, display_name="  Ada \n Lovelace ")
    assert User.objects.get().display_name == "Ada Lovelace"


def test_a_closed_site_shows_a_closed_door(client, settings):
    settings.SIGNUP_OPEN = False
    response = client.get(reverse("account_signup"))
    assert "Sign-up is closed" in read(response).text
    sign_up(client)
    assert not User.objects.exists()


def test_many_sign_ups_from_one_address_are_slowed_down(client):
    for n in range(20):
        sign_up(client, username=f"robot{n}", email="", password1="short")
    response = sign_up(client)
    assert (response.status_code, response["Retry-After"]) == (429, "60")
    assert "Too many attempts" in read(response).text
    assert not User.objects.exists()


def test_a_user_name_with_other_characters_is_refused_in_the_words_of_the_hint(client):
    page = read(sign_up(client, username="ada lovelace"))
    assert "Use only letters, digits and @ . + - _" in page.text
    assert "@/./+/-/_" not in page.text
