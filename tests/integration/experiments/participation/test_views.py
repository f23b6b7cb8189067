import json

import pytest
from django.urls import reverse
from django.utils import timezone

from accounts.models import AuditEntry, User
from experiments.models import Participant, PersonalLink, Study, StudyMember
from experiments.participation import links
from experiments.participation.withdrawal import deletion
from sessions.models import Session
from surveys.models import Response
from tests.support.browsers.html_page import faults, read
from tests.support.people import PASSWORD, person
from tests.support.studies import participants as p
from tests.support.studies.study_pages import buttons
from tests.support.studies.study_walk import Walker

pytestmark = pytest.mark.django_db
FRONT = "/studies/exploration/"


@pytest.fixture
def study():
    return p.published(p.of("exploration"))


def signed_in(client, username="ada", **more):
    user = person(username, **more)
    client.force_login(user)
    return user


# --- the front page -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("language", "title", "minutes", "join"),
    [
        ("en", "Explore an office with a robot", "Up to 15 minutes of driving", "Take part"),
        ("es", "Explora una oficina con un robot", "Hasta 15 minutos", "Participar"),
    ],
)
def test_visitor_reads_about_the_study_and_signs_up(client, study, language, title, minutes, join):
    page = read(client.get(FRONT, headers={"accept-language": language}))
    assert faults(page) == []
    assert title in page.text
    assert minutes in page.text
    link = next(
        e.attributes["href"]
        for e in page.all("a")
        if "signup" in e.attributes.get("href", "") and "button--action" in e.attributes["class"]
    )
    made = client.post(link, {"username": "ada", "password1": PASSWORD, "next": FRONT})
    assert made.url == FRONT
    page = read(client.get(FRONT, headers={"accept-language": language}))
    assert buttons(page) == [join]


def test_limited_recruitment_parameters_survive_the_sign_up(client, study):
    client.get(
        FRONT,
        {"": "x", "ctrl": "a\x00b", "PROLIFIC_PID": "5f", "STUDY_ID": "s" * 300}
        | {f"x{n}": "1" for n in range(20)},
    )
    client.post(
        reverse("account_signup"), {"username": "ada", "password1": PASSWORD, "next": FRONT}
    )
    assert client.post(FRONT).url == FRONT + "step/"
    assert Participant.objects.get().recruitment_id == "5f"
    kept = Participant.objects.get().recruitment
    assert kept["PROLIFIC_PID"] == "5f"
    assert len(kept) == 10
    assert not kept.keys() & {"", "ctrl"}
    assert len(kept["STUDY_ID"]) == 100


def test_taking_part_twice_makes_one_participant(client, study):
    signed_in(client)
    for _ in range(2):
        assert client.post(FRONT).url == FRONT + "step/"
    assert Participant.objects.count() == 1
    assert buttons(read(client.get(FRONT))) == ["Continue where you left off"]


def test_a_post_by_a_stranger_leads_to_the_sign_up(client, study):
    assert client.post(FRONT).url.startswith("/accounts/signup/?next=%2Fstudies%2F")
    assert not Participant.objects.exists()


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"status": "closed"}, "This study is over"),
        ({"entry": "personal"}, "By invitation"),
        ({}, "This study is full"),
        ({"opening_hours": p.in_two_days()}, "Closed at the moment"),
    ],
)
def test_study_that_admits_no_participants_now_explains_why(client, study, fields, words):
    signed_in(client)
    Study.objects.update(**fields)
    if words == "This study is full":
        p.fill(study)
    before = Participant.objects.count()
    page = read(client.get(FRONT))
    assert faults(page) == []
    assert words in page.text
    assert client.post(FRONT).url == FRONT
    assert Participant.objects.count() == before


def test_the_hours_are_read_as_days_of_the_week(client, study):
    hours = [
        {"days": [0, 1, 2, 4], "start": "09:00", "end": "17:00"},
        {"days": [0, 1, 2, 3, 4, 5, 6], "start": "20:00", "end": "22:00"},
    ]
    Study.objects.update(opening_hours=hours, time_zone="Europe/Madrid")
    text = read(client.get(FRONT)).text
    assert "Mon–Wed, Fri, 09:00–17:00" in text
    assert "every day, 20:00–22:00" in text
    assert "Europe/Madrid" in text


def test_researchers_see_a_marked_draft_and_take_part_as_pilots(client):
    draft = p.publishing.store(p.of("exploration"), timezone.now())
    assert client.get(FRONT).status_code == 404
    user = signed_in(client)
    assert client.get(FRONT).status_code == 404
    StudyMember.objects.create(slug=draft.slug, user=user, role="researcher")
    page = read(client.get(FRONT))
    assert faults(page) == []
    assert "This is a draft" in page.text
    client.post(FRONT)
    assert Participant.objects.get().kind == "pilot"
    assert "This is a draft" in read(client.get(FRONT + "step/")).text


def test_the_home_page_leads_to_open_studies_and_to_no_others(client, study):
    p.publishing.store(p.of("assistance"), timezone.now())
    page = read(client.get("/"))
    assert faults(page) == []
    hrefs = [e.attributes.get("href") for e in page.all("a")]
    assert FRONT in hrefs
    assert "/studies/assistance/" not in hrefs
    Study.objects.update(entry="personal")
    assert FRONT not in [e.attributes.get("href") for e in read(client.get("/")).all("a")]


# --- personal links -------------------------------------------------------------------------------


def path_of(token: str) -> str:
    return reverse("study_link", args=[token])


def test_reading_a_personal_link_uses_nothing_up_and_pressing_the_button_does(client, study):
    _row, token = links.make(study, now=timezone.now())
    page = read(client.get(path_of(token)))
    assert faults(page) == []
    assert "you don't need an account" in page.text
    user = signed_in(client)
    assert "Accept the invitation" in read(client.get(path_of(token))).text
    assert PersonalLink.objects.get().redeemed_at is None
    assert client.post(path_of(token)).url == FRONT + "step/"
    participant = Participant.objects.get()
    assert (participant.user, participant.access) == (user, "invitation")
    assert PersonalLink.objects.get().participant == participant
    assert client.post(path_of(token)).url == FRONT + "step/", "the same person may press it again"
    assert Participant.objects.count() == 1


def test_a_used_link_admits_no_other_participant(client, study):
    _row, token = links.make(study, now=timezone.now())
    links.redeem(token, person("first"), language="en", now=timezone.now())
    signed_in(client, "second")
    for response in (client.get(path_of(token)), client.post(path_of(token))):
        assert response.status_code == 410
        page = read(response)
        assert faults(page) == []
        assert "It has already been used" in page.text
    assert Participant.objects.count() == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"expires_at": p.later(-60)}, "It has expired"),
        ({"revoked_at": p.later(-60)}, "It was cancelled"),
        ({"token_sha256": "0" * 64}, "This invitation doesn't exist"),
    ],
)
def test_an_invalid_link_has_a_reason(client, study, change, words):
    _row, token = links.make(study, now=timezone.now())
    PersonalLink.objects.update(**change)
    signed_in(client)
    response = client.post(path_of(token))
    assert response.status_code == 410
    assert words in read(response).text
    assert not Participant.objects.exists()


@pytest.mark.parametrize(
    ("status", "words"),
    [
        ("closed", "The study is over and no longer accepts participants."),
        ("draft", "has not started yet"),
    ],
)
def test_a_link_to_a_study_that_is_not_open_admits_no_participant(client, study, status, words):
    _row, token = links.make(study, now=timezone.now())
    Study.objects.update(status=status)
    signed_in(client)
    response = client.post(path_of(token))
    assert words in read(response).text
    assert not Participant.objects.exists()


def test_a_bots_link_makes_a_bot_also_of_a_draft_and_works_again(client, study):
    Study.objects.update(status="draft")
    _row, token = links.make(study, access="open", kind="bot", now=timezone.now())
    signed_in(client)
    assert client.post(path_of(token)).url == FRONT + "step/"
    assert (Participant.objects.get().kind, Participant.objects.get().access) == ("bot", "open")
    Participant.objects.update(status="finished", step="thanks")
    assert client.post(FRONT).url == FRONT + "step/"
    assert Participant.objects.get().visit == 2


def test_a_revoked_link_stays_unused_and_one_that_an_account_used_cannot_be_revoked(study):
    now = timezone.now()
    first, _ = links.make(study, now=now)
    assert links.revoke(first, now)
    assert not links.revoke(first, now)
    second, token = links.make(study, now=now)
    links.redeem(token, person(), language="en", now=now)
    assert not links.revoke(second, now)


# --- own data -------------------------------------------------------------------------------------


@pytest.fixture
def walker(study):
    found = Walker(study, person(email="ada@example.org"), p.site())
    found.come()
    for _step in range(4):
        found.do()
    assert found.participant.step == "experience"
    return found


def test_everything_that_is_kept_can_be_downloaded(walker):
    answer = walker.client.get(reverse("own_data_download"))
    assert "attachment" in answer["Content-Disposition"]
    data = json.loads(answer.content)
    assert data["account"]["email"] == "ada@example.org"
    assert data["studies"][0]["consents"][0]["text"].startswith("You will drive a real robot")
    assert [one["questionnaire"] for one in data["questionnaires"]] == ["ict", "experience"]
    assert data["drives"][0]["outcome"] == "completed"
    steps = [one["step"] for one in data["studies"][0]["steps"]]
    assert steps == ["consent", "about_you", "instructions", "task", "experience"]


def test_the_page_of_ones_own_data_is_sound_and_leads_to_everything(walker):
    page = read(walker.client.get(reverse("own_data")))
    assert faults(page) == []
    offered = {"Download the receipt", "Go to the study", "Leave the study", "Download my data"}
    assert offered <= set(buttons(page))
    links = read(walker.client.get(reverse("profile"))).all("a")
    assert reverse("own_data") in [one.attributes.get("href") for one in links]


def test_agreement_to_publishing_can_be_taken_back_without_leaving(walker):
    walker.participant.consents.update(sharing=True, sharing_text="My data may be published.")
    leaving = reverse("study_withdraw", args=[walker.participant.code])
    own = read(walker.client.get(reverse("own_data")))
    assert "Take this back" in buttons(own)
    assert faults(own) == []
    page = read(walker.client.get(leaving))
    assert faults(page) == []
    assert "Do not publish my data" in buttons(page)
    address = reverse("study_unshare", args=[walker.participant.code])
    page = read(walker.client.post(address, follow=True))
    assert "made from now on do not have your data" in page.text
    assert "Do not publish my data" not in buttons(page)
    assert not walker.participant.consents.filter(sharing=True).exists()
    assert Participant.objects.get().status == "active"
    assert AuditEntry.objects.filter(act="sharing_taken_back").count() == 1


def test_a_withdrawal_leaves_only_the_day_the_step_and_the_cell(walker):
    page = reverse("study_withdraw", args=[walker.participant.code])
    cell = walker.participant.cell
    assert faults(read(walker.client.get(page))) == []
    assert Participant.objects.get().status == "active", "asking does nothing"
    before = timezone.now().date()
    assert "has been deleted" in read(walker.client.post(page)).text
    row = Participant.objects.get()
    assert (row.status, row.withdrawn_step) == ("withdrawn", "experience")
    assert (row.cell, row.stage) == (cell, "filled")
    assert row.withdrawn_at in {before, timezone.now().date()}, "midnight may have passed"
    assert (row.user, row.age, row.recruitment, row.completion_code) == (None, None, {}, "")
    for deleted in (Session.objects, Response.objects, row.drives, row.consents):
        assert not deleted.exists()
    assert walker.client.get(walker.url()).url == walker.url("study")
    assert walker.client.get(page).status_code == 404
    deletion.withdraw(row, p.later(86400))
    assert Participant.objects.get().withdrawn_at == row.withdrawn_at


def test_a_withdrawal_before_the_robot_moved_frees_the_place(study):
    participant = p.assign(p.comer(study, person()), "giraff_open")
    left = deletion.withdraw(participant, timezone.now())
    assert (left.stage, left.cell) == ("freed", "giraff_open")


def test_withdrawal_ends_a_live_drive_and_deletes_it_after_all_notices(study):
    robot = p.site()
    participant = p.assign(p.comer(study, person()), "giraff_open")
    drive = p.drive_of(robot, participant, moved=True)
    waiting = deletion.withdraw(participant, timezone.now())
    session = Session.objects.get()
    assert (session.state, session.outcome) == ("ended", "cancelled")
    assert session.outcome_reason == "withdrawn"
    assert (waiting.pk, waiting.stage, waiting.user) == (participant.pk, "filled", None)
    deletion.clear_settled(now=timezone.now())
    assert Session.objects.count() == 1, "the session manager has not ended it yet"
    Session.objects.update(closed_at=timezone.now())
    deletion.clear_settled(now=timezone.now())
    assert Session.objects.count() == 1, "it is still being settled"
    type(drive).objects.update(settled_at=timezone.now())
    deletion.clear_settled(now=timezone.now())
    assert not Session.objects.exists()
    assert not type(drive).objects.exists()
    left = Participant.objects.get()
    assert (left.stage, left.code == participant.code) == ("filled", False)


def test_a_withdrawal_under_way_is_left_alone_and_one_that_was_cut_off_is_finished(study):
    now = timezone.now()
    participant = p.comer(study, person())
    link, _token = links.make(study, now=now)
    type(link).objects.filter(pk=link.pk).update(participant=participant, redeemed_at=now)
    type(participant).objects.filter(pk=participant.pk).update(
        status="withdrawn", withdrawn_at=now.date(), seen_at=now
    )
    deletion.clear_settled(now=now)
    assert Participant.objects.get().pk == participant.pk
    assert type(link).objects.get().participant_id == participant.pk
    deletion.clear_settled(now=now + 2 * deletion.MAX_REQUEST)
    assert Participant.objects.get().slot.startswith(deletion.LEFT)
    assert not type(link).objects.exists()


def test_drives_of_those_who_take_part_are_never_cleared(study):
    participant = p.assign(p.comer(study, person()), "giraff_open")
    p.drive_of(p.site(), participant, outcome="completed", moved=True)
    deletion.clear_settled(now=timezone.now())
    assert Session.objects.count() == 1


def test_withdrawal_keeps_other_drives_and_studies(walker):
    p.session_of(walker.robot, walker.participant, outcome="completed", moved=True)
    other = p.comer(p.published(p.of("assistance")), walker.user)
    deletion.withdraw(walker.participant, timezone.now())
    assert Session.objects.count() == 1
    other.refresh_from_db()
    assert (other.status, other.user) == ("active", walker.user)


def test_an_account_is_deleted_only_when_its_name_is_typed(walker):
    url = reverse("own_data_delete")
    walker.client.post(url, {"username": "bob"})
    assert User.objects.count() == 1
    assert walker.client.post(url, {"username": "ada"}, follow=True).status_code == 200
    assert not User.objects.exists()
    assert Participant.objects.get().status == "withdrawn"
    assert not Session.objects.exists()
    assert not Response.objects.exists()
    assert walker.client.get(reverse("profile")).status_code == 302


def test_account_of_a_driver_or_an_administrator_is_not_deleted(walker, client):
    def delete():
        page = reverse("own_data_delete")
        return read(walker.client.post(page, {"username": "ada"}, follow=True))

    session = p.session_of(walker.robot, walker.participant)
    page = delete()
    assert "Leave the robot or its queue first" in page.text
    assert faults(page) == []
    session.delete()
    User.objects.update(is_staff=True)
    assert "Another administrator" in delete().text
    assert User.objects.count() == 1


@pytest.mark.parametrize("name", ["own_data", "own_data_download"])
def test_own_data_is_for_who_is_signed_in(client, name):
    assert client.get(reverse(name)).url.startswith("/accounts/login/")


def test_a_get_deletes_nothing(walker):
    assert walker.client.get(reverse("own_data_delete")).status_code == 405
