"""Accounts without a user name and password: how they are made, entered again and kept small."""

import importlib
import re

import pytest
from django.apps import apps
from django.test import Client, RequestFactory
from django.urls import reverse
from django.utils import translation

from accounts.models import AuditEntry, EntryCode, User
from accounts.passwordless import (
    create_guest,
    guest_of,
    new_entry_code,
    sign_in,
    sign_out_everywhere,
)
from tests.support.people import person

pytestmark = pytest.mark.django_db
PARTICIPANT, VISITOR = User.Kind.PARTICIPANT, User.Kind.VISITOR


def entered(user) -> Client:
    """A browser in which a guest is signed in, as a view does it."""
    client = Client()
    request = RequestFactory().get("/")
    request.session = client.session
    sign_in(request, user)
    request.session.save()
    client.cookies["sessionid"] = request.session.session_key
    return client


def is_signed_in(client: Client) -> bool:
    return client.get(reverse("home")).wsgi_request.user.is_authenticated


@pytest.mark.parametrize("kind", [PARTICIPANT, VISITOR])
def test_a_guest_has_no_password_and_a_generated_name(kind):
    guest, other = create_guest(kind), create_guest(kind)
    assert not guest.has_usable_password()
    assert guest.is_guest
    assert guest.kind == kind
    for language, names in (("en", ("Participant", "Guest")), ("es", ("Participante", "Invitado"))):
        with translation.override(language):
            assert guest.shown_name == other.shown_name == names[kind == VISITOR]
    assert guest.sent_name == f"({kind})"
    assert guest.username != other.username
    assert (guest.is_staff, guest.is_superuser, guest.email) == (False, False, "")
    assert AuditEntry.objects.filter(act="guest_created", person=guest.pk).exists()


@pytest.mark.parametrize("kind", ["full", "king", ""])
def test_only_the_kinds_of_guests_are_made_so(kind):
    with pytest.raises(ValueError, match="no kind of guest"):
        create_guest(kind)
    assert not User.objects.exists()


def test_people_who_sign_up_have_full_accounts():
    assert person().kind == User.Kind.FULL
    assert not person("bea").is_guest


def test_a_code_can_be_read_out_and_is_found_however_it_is_typed():
    guest = create_guest(PARTICIPANT)
    code = new_entry_code(guest)
    assert re.fullmatch("[2-9A-HJ-NP-Z]{4}-[2-9A-HJ-NP-Z]{4}", code)
    for typed in (code, code.lower(), code.replace("-", ""), f" {code.replace('-', ' ')} "):
        assert guest_of(typed) == guest
    for wrong in ("", "-", code[:-1], code + "2", "2222-2222"):
        assert guest_of(wrong) is None


def test_a_code_is_stored_as_a_hash_that_the_site_alone_can_make(settings):
    guest = create_guest(PARTICIPANT)
    code = new_entry_code(guest)
    stored = EntryCode.objects.values().get()
    assert code not in str(stored)
    assert code.replace("-", "") not in str(stored)
    old, settings.SECRET_KEY = settings.SECRET_KEY, "another key of the site"
    assert guest_of(code) is None
    settings.SECRET_KEY_FALLBACKS = [old]
    assert guest_of(code) == guest


def test_a_new_code_ends_the_old_one():
    guest = create_guest(PARTICIPANT)
    first, second = new_entry_code(guest), new_entry_code(guest)
    assert guest_of(first) is None
    assert guest_of(second) == guest


def test_the_code_of_a_closed_account_leads_nowhere():
    guest = create_guest(PARTICIPANT)
    code = new_entry_code(guest)
    User.objects.filter(pk=guest.pk).update(is_active=False)
    assert guest_of(code) is None


def test_full_accounts_have_no_codes_and_are_not_entered_without_their_password():
    ada = person()
    with pytest.raises(ValueError, match="password"):
        new_entry_code(ada)
    with pytest.raises(ValueError, match="password"):
        entered(ada)


def test_a_guest_enters_and_is_signed_out_everywhere_at_once():
    guest = create_guest(PARTICIPANT)
    code = new_entry_code(guest)
    phone, laptop = entered(guest), entered(guest)
    assert is_signed_in(phone)
    assert is_signed_in(laptop)
    sign_out_everywhere(guest)
    assert not is_signed_in(phone)
    assert not is_signed_in(laptop)
    assert guest_of(code) is None
    assert is_signed_in(entered(User.objects.get()))


@pytest.mark.parametrize(
    "name", ["profile", "account_set_password", "account_change_password", "account_email"]
)
def test_a_guest_gets_no_password_address_or_name(name):
    guest = create_guest(PARTICIPANT)
    client = entered(guest)
    words = "seven green kettles"
    form = {"display_name": "Ada", "email": "ada@example.org", "action_add": ""}
    for answer in (
        client.get(reverse(name)),
        client.post(reverse(name), form | {"password1": words, "password2": words}),
    ):
        assert answer.status_code == 302
        assert answer.url == reverse("own_data")
    guest.refresh_from_db()
    assert not guest.has_usable_password()
    assert (guest.email, guest.display_name) == ("", "")


def test_the_administration_lists_guests_by_kind_and_does_not_change_it(admin_client):
    guest = create_guest(PARTICIPANT)
    person("ada")
    people = reverse("admin:accounts_user_changelist")
    found = admin_client.get(people, {"kind__exact": "participant"}).context["cl"].queryset
    assert list(found) == [guest]
    page = reverse("admin:accounts_user_change", args=[guest.pk])
    admin_client.post(page, {"username": guest.username, "kind": "full", "is_active": "on"})
    guest.refresh_from_db()
    assert guest.kind == PARTICIPANT


def test_only_guests_lose_the_name_that_an_earlier_version_gave_them():
    migration = importlib.import_module("accounts.migrations.0005_guests_without_name")
    given, named, full = create_guest(VISITOR), create_guest(VISITOR), person("Guest")
    User.objects.filter(pk__in=(given.pk, full.pk)).update(display_name="Invitado")
    User.objects.filter(pk=named.pk).update(display_name="Ana")
    migration.forget_given_names(apps, None)
    names = [User.objects.get(pk=user.pk).display_name for user in (given, named, full)]
    assert names == ["", "Ana", "Invitado"]
