"""Three ways to run a site: addresses are never confirmed, may be, or must be."""

import re

import pytest
from allauth.account.models import EmailAddress
from django.core import mail
from django.urls import reverse

from accounts.models import User
from tests.support.browsers.html_page import read
from tests.support.people import PASSWORD, person

pytestmark = pytest.mark.django_db
FORM = {"username": "ada", "display_name": "", "email": "ada@example.org", "password1": PASSWORD}


@pytest.fixture
def verification(settings):
    def choose(mode: str) -> None:
        settings.ACCOUNT_EMAIL_VERIFICATION = mode
        email = "email*" if mode == "mandatory" else "email"
        settings.ACCOUNT_SIGNUP_FIELDS = ["username*", email, "password1*"]

    return choose


def link_of(message) -> str:
    return re.search(r"https?://testserver(/\S+)", message.body)[1]


def signed_in(client) -> bool:
    return "_auth_user_id" in client.session


def test_without_verification_nothing_is_sent(client, verification):
    verification("none")
    client.post(reverse("account_signup"), FORM)
    assert signed_in(client)
    assert mail.outbox == []


def test_with_optional_verification_a_visitor_may_drive_and_confirm_later(client, verification):
    verification("optional")
    client.post(reverse("account_signup"), FORM)
    assert signed_in(client)
    assert not EmailAddress.objects.get().verified
    confirm = link_of(mail.outbox[0])
    assert "Is ada@example.org the address of ada?" in read(client.get(confirm)).text
    assert not EmailAddress.objects.get().verified, "a mail scanner may have followed the link"
    client.post(confirm)
    assert EmailAddress.objects.get().verified


def test_with_mandatory_verification_a_visitor_waits_for_the_link(client, verification):
    verification("mandatory")
    response = client.post(reverse("account_signup"), FORM, follow=True)
    assert "Check your e-mail" in read(response).text
    assert not signed_in(client)
    client.post(reverse("account_login"), {"login": "ada", "password": PASSWORD})
    assert not signed_in(client)
    client.post(link_of(mail.outbox[0]))
    client.post(reverse("account_login"), {"login": "ada", "password": PASSWORD})
    assert signed_in(client)


def test_with_mandatory_verification_the_address_is_required(client, verification):
    verification("mandatory")
    response = client.post(reverse("account_signup"), FORM | {"email": ""})
    assert list(response.context["form"].errors) == ["email"]
    assert not User.objects.exists()


def test_with_mandatory_verification_sign_up_does_not_tell_who_has_an_account(client, verification):
    verification("mandatory")
    user = person("first", email="ada@example.org")
    EmailAddress.objects.create(user=user, email=user.email, verified=True, primary=True)
    response = client.post(reverse("account_signup"), FORM, follow=True)
    assert "Check your e-mail" in read(response).text
    assert User.objects.count() == 1


def test_a_forged_link_is_shown_as_expired(client):
    page = read(client.get(reverse("account_confirm_email", args=["made-up"])))
    assert "This link has expired" in page.text


def test_a_visitor_adds_and_removes_addresses(client):
    client.force_login(person())
    url = reverse("account_email")
    assert "has no e-mail address" in read(client.get(url)).text
    client.post(url, {"action_add": "1", "email": "ada@example.org"})
    page = read(client.get(url))
    assert "ada@example.org" in page.text
    assert "Not confirmed yet" in page.text
    client.post(url, {"action_remove": "1", "email": "ada@example.org"})
    assert not EmailAddress.objects.exists()
