"""Security and caching headers of all answers."""

import pytest
from django.urls import reverse

from tests.support.people import person

pytestmark = pytest.mark.django_db


@pytest.mark.parametrize("name", ["home", "account_login", "manifest"])
def test_every_answer_limits_what_a_page_may_use_and_who_may_embed_it(client, name):
    headers = client.get(reverse(name)).headers
    allowed = dict(part.split("=") for part in headers["Permissions-Policy"].split(", "))
    assert {
        allowed[feature] for feature in ("camera", "microphone", "display-capture", "fullscreen")
    } == {"(self)"}
    assert {allowed[feature] for feature in ("geolocation", "usb", "payment")} == {"()"}
    assert "bluetooth" not in allowed  # browsers warn of it on every page
    assert headers["Cross-Origin-Resource-Policy"] == "same-origin"


PRIVATE = ("profile", "account_email", "account_change_password")


@pytest.mark.parametrize("name", [*PRIVATE, "admin:index", "admin:accounts_user_changelist"])
def test_personal_page_is_not_cached(client, name):
    client.force_login(person("ada", is_staff=True, is_superuser=True))
    kept = client.get(reverse(name))["Cache-Control"]
    assert "private" in kept
    assert "no-store" in kept


def test_page_that_reads_no_session_may_be_cached(client):
    assert not client.get(reverse("manifest")).has_header("Cache-Control")
