"""Taking part without a user name and password: by a personal link, or with a code."""

import re

import pytest
from django.test import Client
from django.urls import reverse
from django.utils import timezone

from accounts.models import AuditEntry, EntryCode, User
from accounts.passwordless import NEW_GUESTS, WRONG_CODES
from experiments.models import Participant, PersonalLink, Study
from experiments.participation import links
from robots.access import may_drive, may_observe, robots_visible_to
from robots.models import Robot, RobotPermit
from tests.support.browsers.html_page import faults, read
from tests.support.people import person
from tests.support.studies import participants as p

pytestmark = pytest.mark.django_db
FRONT, STEP = "/studies/exploration/", "/studies/exploration/step/"
CODE = re.compile("[2-9A-HJ-NP-Z]{4}-[2-9A-HJ-NP-Z]{4}")


@pytest.fixture
def study():
    return p.published(p.of("exploration"), entry="code")


def take_part(client: Client) -> str:
    """Press the button of the front page, and return the code that is shown."""
    page = read(client.post(FRONT))
    assert faults(page) == []
    assert "Write down this code. You need it to continue on another device." in page.text
    return CODE.search(page.text)[0]


def enter(client: Client, code: str):
    return client.post(reverse("study_code"), {"code": code})


def link_to(study, **more) -> str:
    return reverse("study_link", args=[links.make(study, now=timezone.now(), **more)[1]])


# --- with a code ----------------------------------------------------------------------------------


def test_a_stranger_takes_part_without_an_account_and_continues_on_another_device(client, study):
    page = read(client.get(FRONT))
    assert faults(page) == []
    assert "You don't need an account" in page.text
    code = take_part(client)
    guest = Participant.objects.get().user
    assert (guest.kind, guest.has_usable_password()) == ("participant", False)
    assert read(client.get(STEP)).all("h1")
    other = Client()
    assert other.get(STEP).url == FRONT
    assert enter(other, code.lower().replace("-", " ")).url == STEP
    assert other.get(STEP).status_code == 200
    assert Participant.objects.count() == 1
    assert enter(other, code).url == STEP, "a second time, too"


def test_pressing_the_button_again_goes_on_and_shows_no_code(client, study):
    take_part(client)
    assert client.post(FRONT).url == STEP
    assert User.objects.count() == Participant.objects.count() == EntryCode.objects.count() == 1
    assert not CODE.search(read(client.get(FRONT)).text)


def test_a_wrong_code_is_answered_clearly_and_not_for_ever(client, study):
    for _ in range(WRONG_CODES.limit):
        answer = enter(client, "2222-2222")
        assert answer.status_code == 422
    assert "This code isn't known" in read(answer).text
    assert faults(read(answer)) == []
    assert enter(client, "").status_code == 429
    code = take_part(Client())
    assert enter(client, code).status_code == 429


def test_one_address_does_not_make_accounts_without_end(study, monkeypatch):
    monkeypatch.setattr(NEW_GUESTS.__class__, "count", lambda *_: False)
    for address in (FRONT, link_to(study)):
        answer = Client().post(address)
        assert answer.status_code == 429
        assert int(answer["Retry-After"]) >= 1
    assert not User.objects.exists()
    assert not Participant.objects.exists()


def test_a_study_with_an_open_link_still_asks_for_an_account(client, study):
    Study.objects.update(entry="open")
    assert client.post(FRONT).url.startswith("/accounts/signup/")
    assert not User.objects.exists()


def test_a_full_account_takes_part_with_it(client, study):
    ada = person()
    client.force_login(ada)
    assert client.post(FRONT).url == STEP
    assert Participant.objects.get().user == ada


def test_the_home_page_leads_to_a_study_without_an_account(client, study):
    assert FRONT in [e.attributes.get("href") for e in read(client.get("/")).all("a")]


def test_next_participant_at_a_shared_computer_starts_as_a_new_one(client, study):
    take_part(client)
    page = read(client.get(FRONT))
    assert "Does someone else want to take part on this device?" in page.text
    Participant.objects.update(status="finished")
    assert "Does someone else want to take part" in read(client.get(FRONT)).text
    assert client.post(reverse("account_logout"), {"next": FRONT}).url == FRONT
    take_part(client)
    assert Participant.objects.count() == 2


# --- with a personal link -------------------------------------------------------------------------


def test_a_personal_link_is_all_that_one_person_needs_on_every_device(client, study):
    Study.objects.update(entry="personal")
    address = link_to(study)
    page = read(client.get(address))
    assert faults(page) == []
    assert "you don't need an account" in page.text
    assert not User.objects.exists(), "reading the page uses nothing up"
    assert client.post(address).url == STEP
    first = Participant.objects.get()
    assert (first.user.kind, first.access) == ("participant", "invitation")
    other = Client()
    page = read(other.get(address))
    assert faults(page) == []
    assert "Continue where you left off" in page.text
    assert other.post(address).url == STEP
    assert other.get(STEP).status_code == client.get(STEP).status_code == 200
    assert (Participant.objects.count(), User.objects.count()) == (1, 1)


def test_a_second_person_at_the_same_computer_opens_their_own_link(client, study):
    one, two = link_to(study), link_to(study)
    client.post(one)
    assert "you don't need an account" in read(client.get(two)).text
    client.post(two)
    assert {row.user for row in Participant.objects.all()} == set(User.objects.all())
    assert User.objects.count() == 2


def test_link_used_by_a_guest_refuses_accounts(client, study):
    address = link_to(study)
    Client().post(address)
    client.force_login(person())
    assert client.post(address).status_code == 410
    assert Participant.objects.count() == 1


def test_a_revoked_link_lets_its_guest_in_no_more_and_ends_their_sessions(client, study):
    address = link_to(study)
    client.post(address)
    link = PersonalLink.objects.get()
    assert link.is_revocable
    assert links.revoke(link, timezone.now())
    assert not PersonalLink.objects.get().is_revocable
    assert client.get(STEP).url == FRONT
    for browser in (client, Client()):
        answer = browser.post(address)
        assert answer.status_code == 410
        assert "It was cancelled" in read(answer).text
    assert Participant.objects.get().status == "active", "their data stays"
    assert not links.revoke(link, timezone.now())


def test_an_expired_link_still_lets_in_who_used_it_before(client, study):
    address = link_to(study)
    client.post(address)
    PersonalLink.objects.update(expires_at=p.later(-60))
    assert Client().post(address).url == STEP


def test_of_two_who_press_at_once_the_second_leaves_no_account(study, monkeypatch):
    _row, token = links.make(study, now=timezone.now())
    held = links.find(token, person("first"), timezone.now())
    links.redeem(token, User.objects.get(), language="en", now=timezone.now())
    monkeypatch.setattr(links, "find", lambda *_: held)
    assert Client().post(reverse("study_link", args=[token])).status_code == 410
    assert [user.username for user in User.objects.all()] == ["first"]
    assert Participant.objects.count() == 1


def test_a_bots_link_still_asks_for_an_account_whose_name_tells_it_apart(client, study):
    address = link_to(study, kind="bot")
    assert "Sign up and take part" in read(client.get(address)).text
    assert client.post(address).url.startswith("/accounts/signup/")


# --- what a guest may do --------------------------------------------------------------------------


def test_a_guest_drives_the_studys_robot_at_its_step_and_no_other_robot_ever(client, study):
    robot = p.site()
    other = Robot.objects.create(name="attic", title="Attic")
    take_part(client)
    own = Participant.objects.get()
    assert not may_drive(own.user, robot), "the consent comes first"
    p.assign(own, "giraff_open")
    Participant.objects.update(step="task")
    guest = User.objects.get()
    assert may_drive(guest, robot)
    assert not may_observe(guest, robot)
    assert not may_drive(guest, other)
    assert list(robots_visible_to(guest)) == [robot]
    assert client.get(reverse("study_drive", args=["exploration"])).status_code == 200
    assert client.get(reverse("floor_plan", args=["office"])).status_code == 200
    assert client.get(reverse("drive", args=["attic"])).status_code == 404
    Participant.objects.update(status="finished")
    assert not may_drive(guest, robot)


def test_a_guest_drives_no_practice_robot_and_none_by_a_permit(client, study):
    take_part(client)
    Participant.objects.update(step="task")
    guest = User.objects.get()
    practice = Robot.objects.create(name="practice-1", title="Practice", practice=True)
    asked = Robot.objects.create(name="asked", title="Asked", access="invitation")
    RobotPermit.objects.create(robot=asked, user=guest, kind="invited")
    assert not may_drive(guest, practice)
    assert not may_drive(guest, asked)


def test_a_guest_of_one_study_is_a_new_guest_in_another(client, study):
    take_part(client)
    p.published(p.of("assistance"), entry="code")
    answer = client.post("/studies/assistance/")
    assert CODE.search(read(answer).text)
    assert {row.study.slug for row in Participant.objects.all()} == {"exploration", "assistance"}
    assert User.objects.count() == 2
    Study.objects.filter(slug="exploration").update(entry="open")
    page = read(client.get(FRONT))
    assert faults(page) == []
    assert "You are taking part in another study on this device." in page.text


# --- one's own data -------------------------------------------------------------------------------


def test_a_guest_gets_a_new_code_at_their_own_data_and_the_old_one_ends(client, study):
    old = take_part(client)
    page = read(client.get(reverse("own_data")))
    assert faults(page) == []
    assert "Get a new code" in page.text
    new = CODE.search(read(client.post(reverse("own_data_code"))).text)[0]
    assert enter(Client(), old).status_code == 422
    assert enter(Client(), new).url == STEP
    assert AuditEntry.objects.filter(act="entry_code_made").count() == 2


def test_people_with_a_password_get_no_code(client, study):
    client.force_login(person())
    assert client.post(reverse("own_data_code")).status_code == 404
    assert "Get a new code" not in read(client.get(reverse("own_data"))).text


def test_a_guest_downloads_and_deletes_everything(client, study):
    take_part(client)
    data = client.get(reverse("own_data_download")).json()
    assert data["account"]["kind"] == "participant"
    assert [one["study"] for one in data["studies"]] == ["exploration"]
    page = read(client.post(reverse("own_data_delete"), {"username": ""}, follow=True))
    assert "tick the box" in page.text
    assert User.objects.count() == 1
    assert client.post(reverse("own_data_delete"), {"sure": "on"}, follow=True).status_code == 200
    assert not User.objects.exists()
    assert not EntryCode.objects.exists()
    assert Participant.objects.get().status == "withdrawn"


@pytest.mark.parametrize("action", ["decline", "withdraw"])
def test_account_of_a_guest_who_leaves_the_study_is_deleted(client, study, action):
    code = take_part(client)
    own = Participant.objects.get()
    if action == "decline":
        answer = client.post(STEP, {"place": "1.0.consent", "go": "decline"})
    else:
        answer = client.post(reverse("study_withdraw", args=[own.code]))
    assert "has been deleted" in read(answer).text
    assert not User.objects.exists()
    assert Participant.objects.get().status == "withdrawn"
    assert AuditEntry.objects.filter(act="account_deleted").exists()
    assert enter(Client(), code).status_code == 422
    assert client.get(STEP).url == FRONT


def test_an_account_with_a_password_stays_when_its_person_leaves_a_study(client, study):
    client.force_login(person())
    client.post(FRONT)
    client.post(reverse("study_withdraw", args=[Participant.objects.get().code]))
    assert User.objects.count() == 1
    assert client.get(reverse("profile")).status_code == 200
