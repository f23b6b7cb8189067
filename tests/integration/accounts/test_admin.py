import re

import pytest
from allauth.account.models import EmailAddress
from django.contrib.auth.forms import UserChangeForm
from django.contrib.auth.models import Permission
from django.urls import reverse

from accounts.models import User
from tests.support.people import PASSWORD, person

pytestmark = pytest.mark.django_db
PEOPLE = "admin:accounts_user_changelist"


@pytest.fixture
def staff(client):
    boss = person("boss", is_staff=True, is_superuser=True)
    client.force_login(boss)
    return boss


def test_people_are_found_by_name_and_address(client, staff):
    person("ada", display_name="Countess", email="ada@example.org")
    for words in ("ada", "countess", "example.org"):
        found = client.get(reverse(PEOPLE), {"q": words}).context["cl"].queryset
        assert [user.username for user in found] == ["ada"]


def test_accounts_are_closed_and_opened_again_but_not_ones_own(client, staff):
    ada = person("ada")
    chosen = {"_selected_action": [ada.pk, staff.pk]}
    client.post(reverse(PEOPLE), {"action": "close_accounts"} | chosen)
    assert {u.username: u.is_active for u in User.objects.all()} == {"ada": False, "boss": True}
    client.post(reverse(PEOPLE), {"action": "open_accounts"} | chosen)
    assert User.objects.get(username="ada").is_active


def test_a_person_is_made_with_a_shown_name(client, staff):
    form = {"username": "ada", "display_name": "Countess", "email": "", "usable_password": "true"}
    secret = "eleven blue ladders"
    response = client.post(
        reverse("admin:accounts_user_add"), form | {"password1": secret, "password2": secret}
    )
    assert response.status_code == 302
    assert User.objects.get(username="ada").display_name == "Countess"


@pytest.mark.parametrize(
    "name",
    ["admin:index", PEOPLE, "admin:accounts_user_add", "admin:account_emailaddress_changelist"],
)
def test_the_administration_has_the_sites_face_and_needs_no_inline_code(client, staff, name):
    html = client.get(reverse(name)).content.decode()
    assert re.search(r"css/admin(\.[0-9a-f]{12})?\.css", html)
    assert "Telepresence" in html
    assert "style=" not in html
    assert "<style" not in html


def test_staff_without_rights_see_no_numbers(client):
    client.force_login(person("helper", is_staff=True))
    assert "home-card" not in client.get(reverse("admin:index")).content.decode()


def test_the_first_page_tells_that_nothing_is_recorded(client, staff):
    page = client.get(reverse("admin:index")).content.decode()
    assert "The session manager isn't running" in page


@pytest.fixture
def helper(client):
    """A user with permission to change people who is not an administrator."""
    user = person("helper", is_staff=True)
    user.user_permissions.set(
        Permission.objects.filter(codename__in=["view_user", "change_user", "delete_user"])
    )
    client.force_login(user)
    return user


def test_permission_to_change_people_makes_no_administrators(client, helper):
    page = reverse("admin:accounts_user_change", args=[helper.pk])
    form = {"username": "helper", "display_name": "Helper", "email": ""}
    form |= dict.fromkeys(("is_active", "is_staff", "is_superuser"), "on")
    form |= {"user_permissions": [one.pk for one in Permission.objects.all()[:5]]}
    assert client.post(page, form).status_code == 302
    changed = User.objects.get(pk=helper.pk)
    assert (changed.display_name, changed.is_superuser) == ("Helper", False)
    assert changed.user_permissions.count() == 3


def test_permission_to_change_people_excludes_administrators_and_their_passwords(client, helper):
    boss = person("boss", is_staff=True, is_superuser=True)
    secret = dict.fromkeys(("password1", "password2"), "eleven blue ladders")
    form = {"username": "mallory", "usable_password": "true"} | secret
    for name in ("admin:accounts_user_change", "admin:auth_user_password_change"):
        assert client.post(reverse(name, args=[boss.pk]), form).status_code == 403
    client.post(reverse(PEOPLE), {"action": "close_accounts", "_selected_action": [boss.pk]})
    client.post(reverse("admin:accounts_user_delete", args=[boss.pk]), {"post": "yes"})
    kept = User.objects.get(pk=boss.pk)
    assert (kept.username, kept.is_active, kept.check_password(PASSWORD)) == ("boss", True, True)


@pytest.mark.parametrize(
    "lookup",
    ["robot_sessions", "participations", "robot_permits", "password__startswith", "id__startswith"],
)
def test_permission_to_change_people_allows_no_hidden_filters(client, helper, lookup):
    assert client.get(reverse(PEOPLE), {lookup: str(helper.pk)}).status_code == 400


def test_permission_to_change_people_allows_the_shown_filters(client, helper):
    for lookup, value in (("is_staff__exact", "1"), ("date_joined__year", helper.date_joined.year)):
        assert client.get(reverse(PEOPLE), {lookup: value}).context["cl"].result_count == 1


def test_only_permission_to_change_an_address_can_mark_it_as_verified(client, helper):
    address = EmailAddress.objects.create(user=helper, email="helper@example.org")
    chosen = {"action": "make_verified", "_selected_action": [address.pk]}
    for right, is_verified in (("view_emailaddress", False), ("change_emailaddress", True)):
        helper.user_permissions.add(Permission.objects.get(codename=right))
        client.post(reverse("admin:account_emailaddress_changelist"), chosen)
        assert EmailAddress.objects.get().verified is is_verified, right


def test_saving_a_person_keeps_a_password_that_they_changed_meanwhile(client, staff, monkeypatch):
    ada = person("ada")
    address = reverse("admin:accounts_user_change", args=[ada.pk])
    fields = client.get(address).context["adminform"].form.initial
    clean = UserChangeForm.clean

    def slowly(self):
        User.objects.filter(pk=ada.pk).update(password="new")
        return clean(self)

    monkeypatch.setattr(UserChangeForm, "clean", slowly)
    sent = {"username": "ada", "display_name": "Countess", "email": fields["email"]}
    assert client.post(address, sent | {"is_active": "on"}).status_code == 302
    ada.refresh_from_db()
    assert (ada.display_name, ada.password) == ("Countess", "new")
