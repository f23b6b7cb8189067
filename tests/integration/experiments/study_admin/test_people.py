"""The people of a study in the administration: researchers, personal links, opening hours."""

import csv
import io
import re
from urllib.parse import unquote

import pytest
from django.contrib.admin.models import LogEntry
from django.core import mail as mail_box
from django.urls import reverse

from experiments import publishing
from experiments.models import PersonalLink, ResearcherInvitation, Study, StudyMember
from experiments.participation import links
from experiments.study_admin import opening_hours
from tests.integration.experiments.test_publishing import NOW
from tests.support.browsers.html_page import read
from tests.support.people import person
from tests.support.studies.members import signed_in
from tests.support.studies.studies import small_study

pytestmark = pytest.mark.django_db


@pytest.fixture
def study():
    return publishing.store(small_study(), NOW)


@pytest.fixture
def owner(client, study):
    return signed_in(client, "owner", name="olga")


def at(name: str, row: Study) -> str:
    return reverse(f"admin:experiments_study_{name}", args=[row.pk])


def text_after(client, page: str, **fields: str) -> str:
    """Send a form, and return the text of the page that follows."""
    return read(client.post(page, fields, follow=True)).text


def roles() -> dict[str, str]:
    return {one.user.username: one.role for one in StudyMember.objects.select_related("user")}


# --- researchers ----------------------------------------------------------------------------------


def test_an_owner_adds_researchers_changes_their_role_and_removes_them(client, study, owner):
    person("rosa", is_staff=True, email="rosa@example.org")
    client.post(at("members", study), {"add": "1", "person": "ROSA@example.org", "role": "viewer"})
    client.post(at("members", study), {"add": "1", "person": "rosa", "role": "researcher"})
    assert roles() == {"olga": "owner", "rosa": "researcher"}
    rosa = StudyMember.objects.get(user__username="rosa")
    client.post(at("members", study), {"remove": str(rosa.pk)})
    assert roles() == {"olga": "owner"}
    assert LogEntry.objects.filter(user=owner, change_message__contains="rosa").count() == 3


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("nobody", "User not found. Enter an e-mail address"),
        ("visitor", "no e-mail address for an invitation"),
        ("", "required"),
    ],
)
def test_only_staff_can_belong_to_a_study(client, study, owner, name, told):
    person("visitor")
    answer = client.post(at("members", study), {"add": "1", "person": name, "role": "viewer"})
    assert told in read(answer).text
    assert roles() == {"olga": "owner"}


def test_the_last_owner_stays(client, study, owner):
    mine = str(StudyMember.objects.get().pk)
    assert "needs at least one owner" in text_after(client, at("members", study), remove=mine)
    client.post(at("members", study), {"add": "1", "person": "olga", "role": "viewer"})
    assert roles() == {"olga": "owner"}


@pytest.mark.parametrize("forged", ["nonsense", "00000000-0000-0000-0000-000000000000", ""])
def test_a_member_of_another_study_is_not_removed_from_here(client, study, owner, forged):
    other = StudyMember.objects.create(slug="another", user=person("eve"), role="owner")
    for pk in (forged, str(other.pk)):
        assert client.post(at("members", study), {"remove": pk}).status_code == 404
    assert StudyMember.objects.filter(pk=other.pk).exists()


# --- personal links -------------------------------------------------------------------------------


def made(client, study, **fields) -> list[dict[str, str]]:
    form = {"make": "1", "count": "3", "label": "Class A", "access": "open"}
    answer = client.post(at("links", study), form | fields)
    assert "no-store" in answer["Cache-Control"]
    (link,) = [one for one in read(answer).all("a") if "download" in one.attributes]
    assert "shown again" in read(answer).text
    file = unquote(link.attributes["href"].removeprefix("data:text/csv;charset=utf-8,"))
    return list(csv.DictReader(io.StringIO(file)))


def test_links_are_in_the_file_once_and_enrol_participants(client, study, owner):
    rows = made(client, study, days="7")
    labels = ["Class A 1", "Class A 2", "Class A 3"]
    assert [row["label"] for row in rows] == labels
    for row in rows:
        assert row["link"].startswith("http://testserver/studies/link/")
        assert row["expires"]
    tokens = [row["link"].rstrip("/").rsplit("/", 1)[1] for row in rows]
    assert [links.find(token, owner, NOW).label for token in tokens] == labels
    shown = client.get(at("links", study)).content.decode()
    assert "Class A 2" in shown
    assert not any(token in shown for token in tokens)


def test_a_label_is_no_formula_of_a_spreadsheet(client, study, owner):
    assert made(client, study, label="=1+1;=2", count="1")[0]["label"] == "'=1+1;'=2 1"


@pytest.mark.parametrize(
    ("field", "value"),
    [("count", "0"), ("count", "501"), ("count", "many"), ("days", "-1"), ("access", "everything")],
)
def test_links_with_invalid_values_are_not_made(client, study, owner, field, value):
    form = {"make": "1", "count": "3", "access": "open"}
    answer = client.post(at("links", study), form | {field: value})
    assert read(answer).all("ul")
    assert answer["Content-Type"].startswith("text/html")
    assert not PersonalLink.objects.exists()


def test_a_link_is_revoked_once_and_never_one_of_another_study(client, study, owner):
    made(client, study, count="1")
    link = PersonalLink.objects.get()
    page, revoke = at("links", study), {"revoke": str(link.pk)}
    assert "Link revoked. It no longer works." in text_after(client, page, **revoke)
    assert PersonalLink.objects.get().revoked_at is not None
    assert "already been used or revoked" in text_after(client, page, **revoke)
    other, _token = links.make(publishing.store(small_study(slug="another"), NOW), now=NOW)
    for pk in (str(other.pk), "nonsense"):
        assert client.post(page, {"revoke": pk}).status_code == 404


def test_links_lead_to_conditions_that_the_study_has(client, study, owner):
    page = client.get(at("links", study)).content.decode()
    assert 'value="open"' in page
    assert 'value="invitation"' not in page
    invited = {"make": "1", "count": "3", "access": "invitation"}
    assert client.post(at("links", study), invited).status_code == 200
    assert not PersonalLink.objects.exists()


def test_a_closed_study_makes_no_links(client, study, owner):
    Study.objects.update(status=Study.Status.CLOSED)
    form = {"make": "1", "count": "1", "access": "open"}
    assert client.post(at("links", study), form).status_code == 404


# --- hours ----------------------------------------------------------------------------------------


def test_hours_are_written_by_day_and_read_as_a_sentence(client, study, owner):
    week = {f"day_{n}": "9-13, 15:00-17:30" for n in range(5)}
    form = {"time_zone": "Europe/Madrid", **week, "day_5": "10:00-24:00"}
    answer = client.post(at("hours", study), form, follow=True)
    row = Study.objects.get()
    assert row.time_zone == "Europe/Madrid"
    assert row.opening_hours == [
        {"days": [0, 1, 2, 3, 4], "start": "09:00", "end": "13:00"},
        {"days": [0, 1, 2, 3, 4], "start": "15:00", "end": "17:30"},
        {"days": [5], "start": "10:00", "end": "00:00"},
    ]
    page = read(answer)
    assert "Mon-Fri 09:00-13:00; Mon-Fri 15:00-17:30; Sat 10:00-00:00 (Europe/Madrid)" in page.text
    shown = {e.attributes.get("name"): e.attributes.get("value") for e in page.all("input")}
    assert shown["day_0"] == "09:00-13:00, 15:00-17:30"
    assert (shown["day_5"], shown.get("day_6")) == ("10:00-00:00", None)


def test_all_days_empty_means_always_open(client, study, owner):
    Study.objects.update(opening_hours=[{"days": [1], "start": "09:00", "end": "10:00"}])
    client.post(at("hours", study), {"time_zone": "UTC"})
    assert Study.objects.get().opening_hours == []
    assert "always open" in read(client.get(at("hours", study))).text


@pytest.mark.parametrize("text", ["whenever", "9", "9-", "25:00-26:00", "09:70-10:00", "٩-١٠"])
def test_invalid_hours_show_an_error_at_their_day(client, study, owner, text):
    answer = client.post(at("hours", study), {"time_zone": "UTC", "day_2": text})
    assert answer.status_code == 200
    assert read(answer).all("ul")
    assert Study.objects.get().opening_hours == []


def test_a_made_up_time_zone_is_refused(client, study, owner):
    client.post(at("hours", study), {"time_zone": "Mars/Olympus"})
    assert Study.objects.get().time_zone == "UTC"


def test_hours_survive_writing_and_reading():
    hours = [
        {"days": [0, 2], "start": "09:00", "end": "17:00"},
        {"days": [6], "start": "22:00", "end": "02:00"},
    ]
    assert opening_hours.from_days(opening_hours.lines_by_day(hours).values()) == hours
    assert opening_hours.summary(hours, "UTC") == "Mon, Wed 09:00-17:00; Sun 22:00-02:00 (UTC)"


# --- invitations ----------------------------------------------------------------------------------


def invited(client, study, email="nora@example.org", role="researcher") -> str:
    """Send an invitation, and return the path of its link."""
    client.post(at("members", study), {"add": "1", "person": email, "role": role})
    (mail,) = mail_box.outbox
    assert mail.to == [email]
    mail_box.outbox.clear()
    return re.search(r"http://testserver(\S+)", mail.body)[1]


def test_a_person_without_an_account_is_invited_and_becomes_a_researcher(client, study, owner):
    link = invited(client, study)
    assert "nora@example.org" in read(client.get(at("members", study))).text
    client.logout()
    page = client.get(link)
    assert "becomes a researcher" not in read(page).text
    links = [a.attributes["href"] for a in read(page).all("a")]
    assert any(reverse("account_signup") in address for address in links)
    assert client.post(link).status_code == 404
    nora = person("nora", email="nora@example.org")
    client.force_login(nora)
    assert "becomes a researcher" in read(client.get(link)).text
    answer = client.post(link)
    assert answer.headers["Location"] == at("change", study)
    assert roles()["nora"] == "researcher"
    nora.refresh_from_db()
    assert nora.is_staff
    assert client.get(at("change", study)).status_code == 200
    assert client.post(link).status_code == 410, "the link works once"


def test_hidden_operators_and_coders_get_no_access_to_the_administration(client, study, owner):
    link = invited(client, study, role="coder")
    coder = person("carl")
    client.force_login(coder)
    assert client.post(link).headers["Location"] == reverse("study_coding", args=[study.slug])
    coder.refresh_from_db()
    assert not coder.is_staff


def test_invitations_expire_and_are_cancelled(client, study, owner):
    link = invited(client, study)
    ResearcherInvitation.objects.update(expires_at=NOW)
    assert client.get(link).status_code == 410
    client.post(at("members", study), {"cancel": "nora@example.org"})
    assert not ResearcherInvitation.objects.exists()
    assert client.get(link).status_code == 410


def test_new_invitation_of_the_same_address_ends_the_earlier_one(client, study, owner):
    first, second = invited(client, study), invited(client, study, role="viewer")
    assert client.get(first).status_code == 410
    assert client.get(second).status_code == 200


def test_accepting_an_invitation_takes_no_rights_from_an_owner(client, study, owner):
    link = invited(client, study, role="viewer")
    client.post(link)
    assert roles() == {"olga": "owner"}


def test_invitations_end_with_their_study(client, study, owner):
    link = invited(client, study)
    study.delete()
    assert not ResearcherInvitation.objects.exists()
    assert client.get(link).status_code == 410


def test_only_owners_invite(client, study, owner):
    signed_in(client, "viewer")
    sent = {"add": "1", "person": "nora@example.org", "role": "owner"}
    assert client.post(at("members", study), sent).status_code == 404
    assert not mail_box.outbox


def test_invited_people_may_sign_up_where_sign_up_is_closed(client, study, owner, settings):
    settings.SIGNUP_OPEN = False
    link = invited(client, study)
    client.logout()
    assert not asks_for_name(client.get(reverse("account_signup")))
    client.get(link)
    assert asks_for_name(client.get(reverse("account_signup")))


def asks_for_name(response) -> bool:
    return any(e.attributes.get("name") == "username" for e in read(response).all("input"))
