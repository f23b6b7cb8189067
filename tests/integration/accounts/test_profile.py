import pytest
from django.urls import reverse

from accounts.models import User
from tests.support.browsers.html_page import read
from tests.support.people import person

pytestmark = pytest.mark.django_db


def test_a_visitor_changes_the_name_shown_to_others(client):
    client.force_login(person())
    response = client.post(reverse("profile"), {"display_name": " Countess  Ada "}, follow=True)
    assert User.objects.get().display_name == "Countess Ada"
    assert "Saved." in read(response).text


def test_a_refused_name_changes_nothing_not_even_the_header(client):
    client.force_login(person(display_name="Ada"))
    response = client.post(reverse("profile"), {"display_name": "x" * 61})
    assert response.status_code == 200
    header = read(response).all("header")[0]
    assert "Ada" in header.text
    assert "xxx" not in header.text
    assert User.objects.get().display_name == "Ada"


def test_only_the_shown_name_can_be_changed_there(client):
    client.force_login(person())
    client.post(
        reverse("profile"),
        {"display_name": "Ada", "is_staff": "on", "username": "root", "is_superuser": "on"},
    )
    user = User.objects.get()
    assert (user.username, user.is_staff, user.is_superuser) == ("ada", False, False)


def test_a_stranger_has_no_profile(client):
    assert client.get(reverse("profile")).url.startswith(reverse("account_login"))
