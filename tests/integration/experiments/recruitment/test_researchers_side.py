"""What researchers see of recruited participants: the page, the list, payments, and the API."""

import csv
import io

import pytest
from django.core.cache import cache
from django.urls import reverse
from django.utils import timezone

from accounts.models import AuditEntry
from experiments.models import Participant, StudyKey, StudyMember
from experiments.participation import completion
from experiments.participation.withdrawal.deletion import withdraw
from experiments.recruitment import api, payments
from experiments.resources import obstacles_here
from tests.support.browsers.html_page import faults, read
from tests.support.people import person
from tests.support.studies import participants as p
from tests.support.studies.members import member, signed_in

pytestmark = pytest.mark.django_db
API = "/api/v1/studies/exploration/participants/"
LIST = "/admin/experiments/participant/"


@pytest.fixture
def study():
    return p.published(p.of("exploration", recruiting={"site": "prolific"}))


@pytest.fixture
def ada(study):
    given = {"PROLIFIC_PID": "5f0c", "SESSION_ID": "625d", "STUDY_ID": "=1+1"}
    return p.comer(study, person("ada"), recruitment=given)


def found(client, words: str) -> list[str]:
    page = read(client.get(LIST, {"q": words}))
    codes = set(Participant.objects.values_list("code", flat=True))
    return [code for code in codes if code in page.text]


def test_researchers_find_a_participant_by_id_and_viewers_do_not(client, study, ada):
    p.comer(study, person("bob"), recruitment={"PROLIFIC_PID": "b0b"})
    signed_in(client, "researcher", study.slug)
    assert found(client, "5f0c") == [ada.code]
    assert found(client, ada.code) == [ada.code]
    assert "5f0c" in client.get(LIST).content.decode()
    signed_in(client, "viewer", study.slug, "vic")
    assert found(client, "5f0c") == []
    assert found(client, ada.code) == [ada.code]
    assert "5f0c" not in client.get(LIST).content.decode()


def test_the_participants_page_shows_id_and_flags_to_researchers(client, study, ada):
    robot = p.site()
    Participant.objects.filter(pk=ada.pk).update(step="task")
    drive = p.drive_of(robot, p.assign(ada, "giraff_open"), outcome="cancelled")
    begun = drive.granted_at.timestamp() - 60
    p.Drive.objects.update(result={"started": begun})
    url = reverse("admin:experiments_participant_change", args=[ada.pk])
    signed_in(client, "researcher", study.slug)
    page = read(client.get(url))
    assert "never moved the robot" in page.text
    assert "5f0c" in page.text
    signed_in(client, "viewer", study.slug, "vic")
    page = client.get(url).content.decode()
    assert "never moved" not in page
    assert "5f0c" not in page


def test_the_recruitment_page_has_link_codes_and_return_addresses(client, study):
    signed_in(client, "researcher", study.slug)
    page = read(client.get(reverse("admin:experiments_study_recruitment", args=[study.pk])))
    assert faults(page) == []
    assert any(
        one.attributes.get("value", "").endswith(
            "?PROLIFIC_PID={{%PROLIFIC_PID%}}&STUDY_ID={{%STUDY_ID%}}&SESSION_ID={{%SESSION_ID%}}"
        )
        for one in page.all("input")
    )
    for code in completion.codes(study).values():
        assert f"submissions/complete?cc={code}" in page.text
    signed_in(client, "viewer", study.slug, "vic")
    for name in ("recruitment", "payments"):
        url = reverse(f"admin:experiments_study_{name}", args=[study.pk])
        assert client.get(url).status_code == 404


def test_the_payment_table_has_a_line_for_each_participant(client, study, ada):
    completion.conclude(ada, ada.created_at + p.datetime.timedelta(minutes=30))
    p.comer(study, person("pilot"), kind="pilot", recruitment={"PROLIFIC_PID": "x"})
    signed_in(client, "researcher", study.slug)
    text = client.get(reverse("admin:experiments_study_payments", args=[study.pk])).content.decode()
    rows = list(csv.DictReader(io.StringIO(text)))
    assert len(rows) == 1
    row = rows[0]
    assert (row["id"], row["submission"], row["participant"]) == ("5f0c", "625d", ada.code)
    assert (row["outcome"], row["minutes"]) == ("technical_failure", "30.0")
    assert row["code"] == completion.code(study, "technical_failure")


def test_a_second_visit_does_not_change_when_the_first_was_finished(study, ada):
    Participant.objects.filter(pk=ada.pk).update(completion="done")
    ada.refresh_from_db()
    completion.conclude(ada, ada.created_at + p.datetime.timedelta(minutes=30))
    completion.conclude(ada, ada.created_at + p.datetime.timedelta(days=7))
    assert payments.minutes_of(ada) == 30.0


def test_a_participant_who_withdrew_is_still_paid(client, study, ada, key):
    Participant.objects.filter(pk=ada.pk).update(step="task")
    p.drive_of(p.site(), p.assign(ada, "giraff_open"), outcome="completed", moved=True)
    completion.conclude(ada, timezone.now())
    code = completion.code(study, "done")
    withdraw(ada, timezone.now())
    lines = list(payments.payment_rows(study))
    assert [dict(zip(lines[0], line, strict=True)) for line in lines[1:]] == [
        dict.fromkeys(("id", "submission", "participant", "started", "finished", "flags"), "")
        | {"version": 1, "status": "withdrawn", "outcome": "done", "code": code, "minutes": None}
    ]
    (one,) = ask(client, key, id="5f0c").json()["participants"]
    assert (one["id"], one["status"], one["outcome"]) == ("5f0c", "withdrawn", "done")
    assert one["completionCode"] == code
    assert (one["participant"], one["parameters"], one["started"]) == ("", {}, None)
    assert ask(client, key).json()["participants"] == [], "without the id nobody is named"
    signed_in(client, "researcher", study.slug, "rex")
    shown = client.get(LIST).content.decode()
    assert Participant.objects.get().recruitment_id not in shown, "nor is the hash of it"


@pytest.mark.parametrize("is_assigned", [False, True])
def test_a_participant_who_leaves_early_is_paid_as_the_page_promised(
    client, study, ada, key, is_assigned
):
    if is_assigned:
        p.assign(ada, "giraff_open")
    client.force_login(ada.user)
    page = client.post(f"/taking-part/{ada.code}/withdraw/").content.decode()
    code = completion.code(study, "left")
    assert code in page
    head, line = payments.payment_rows(study)
    row = dict(zip(head, line, strict=True))
    assert (row["status"], row["outcome"], row["code"]) == ("withdrawn", "left", code)
    (one,) = ask(client, key, id="5f0c").json()["participants"]
    assert (one["status"], one["outcome"], one["completionCode"]) == ("withdrawn", "left", code)


def test_an_id_that_looks_like_a_formula_is_guarded_in_the_payment_table(client, study):
    p.comer(study, person("eve"), recruitment={"PROLIFIC_PID": '=HYPERLINK("x")'})
    signed_in(client, "researcher", study.slug)
    text = client.get(reverse("admin:experiments_study_payments", args=[study.pk])).content.decode()
    assert "'=HYPERLINK" in text


def test_screening_by_an_unknown_item_or_answer_is_a_problem(study):
    for rule, words in (
        ({"item": "gendre", "answers": ["woman"]}, "no such item"),
        ({"item": "gender", "answers": ["female"]}, "its answers are man, other, woman"),
        ({"item": "gender", "at_least": 3}, ""),
    ):
        definition = p.of("exploration", screening=[{"questionnaire": "ict", **rule}])
        found = [one.sentence(str) for one in obstacles_here(definition)]
        shown = [one for one in found if "ict.gend" in one]
        assert len(shown) == bool(words), shown
        assert all(words in one for one in shown)


# --- the API --------------------------------------------------------------------------------------


@pytest.fixture
def key(study):
    cache.clear()
    user = member("researcher", study.slug, is_staff=True)
    return api.make_key(study.slug, "pay", user, timezone.now())


def ask(client, key: str, **query: str):
    return client.get(API, query, headers={"authorization": f"Bearer {key}"})


def test_a_program_reads_the_status_of_an_id(client, study, ada, key):
    p.comer(study, person("bob"), recruitment={"PROLIFIC_PID": "b0b"})
    answer = ask(client, key, id="5f0c").json()
    assert [one["participant"] for one in answer["participants"]] == [ada.code]
    entry = AuditEntry.objects.get(act="participants_read_by_api")
    assert entry.actor == StudyKey.objects.get().made_by_id
    one = answer["participants"][0]
    assert (one["status"], one["outcome"], one["minutes"]) == ("active", "", None)
    assert one["parameters"]["SESSION_ID"] == "625d"
    completion.conclude(ada, timezone.now())
    one = ask(client, key, id="5f0c").json()["participants"][0]
    assert (one["status"], one["outcome"]) == ("finished", "technical_failure")
    assert one["completionCode"] == completion.code(study, "technical_failure")
    assert len(ask(client, key).json()["participants"]) == 2
    assert ask(client, key, id="nobody").json()["participants"] == []
    assert StudyKey.objects.get().last_used_at is not None


def test_a_long_list_comes_in_pages(client, study, ada, key, monkeypatch):
    monkeypatch.setattr(api, "MAX_LISTED", 1)
    p.comer(study, person("bob"))
    first = ask(client, key).json()
    second = ask(client, key, after=first["next"]).json()
    codes = [one["participant"] for one in (*first["participants"], *second["participants"])]
    assert sorted(codes) == codes
    assert len(set(codes)) == 2
    assert "next" not in second


def test_program_reads_how_many_participants_a_study_has_by_outcome(client, study, ada, key):
    for name, given in {
        "bob": {"status": "finished", "completion": "done"},
        "eve": {"status": "withdrawn"},
        "pam": {"kind": "pilot"},
    }.items():
        row = p.comer(study, person(name))
        Participant.objects.filter(pk=row.pk).update(**given)
    url = "/api/v1/studies/exploration/"
    assert client.get(url).status_code == 401
    shown = client.get(url, headers={"authorization": f"Bearer {key}"}).json()
    (version,) = shown["versions"]
    assert (shown["study"], version["version"], version["status"]) == (study.slug, 1, "published")
    statuses = {"active": 1, "finished": 1, "screened_out": 0, "withdrawn": 1}
    assert (version["participants"], version["outcomes"]) == (statuses, {"done": 1})


@pytest.mark.parametrize("header", ["", "Bearer x", "Bearer 00000000000000000000000000000000.x"])
def test_requests_without_a_key_of_the_study_are_refused(client, study, key, header):
    answer = client.get(API, headers={"authorization": header} if header else {})
    assert answer.status_code == 401
    assert set(answer.json()) == {"apiVersion", "error", "detail"}


def test_a_key_opens_one_study_and_only_while_its_maker_may_see_ids(client, study, ada, key):
    p.published(p.of("assistance"))
    other = client.get(
        "/api/v1/studies/assistance/participants/", headers={"authorization": f"Bearer {key}"}
    )
    assert other.status_code == 401
    StudyMember.objects.update(role="viewer")
    assert ask(client, key).status_code == 401


def test_wrong_keys_and_many_requests_are_limited(client, study, key, monkeypatch):
    for _ in range(api.REFUSED.limit):
        assert ask(client, "wrong").status_code == 401
    answer = ask(client, key)
    assert answer.status_code == 429
    assert int(answer["Retry-After"]) >= 1
    cache.clear()
    monkeypatch.setattr(api.READ.__class__, "count", lambda *_: False)
    assert ask(client, key).status_code == 429


def test_a_key_is_shown_once_and_can_be_revoked(client, study):
    signed_in(client, "researcher", study.slug)
    url = reverse("admin:experiments_study_recruitment", args=[study.pk])
    page = read(client.post(url, {"label": "payments"}))
    shown = next(one.text for one in page.elements if one.attributes.get("id") == "new-key")
    assert ask(client, shown).status_code == 200
    assert shown not in client.get(url).content.decode()
    assert "There is a key of this name" in read(client.post(url, {"label": "payments"})).text
    client.post(url, {"revoke": "payments"})
    assert ask(client, shown).status_code == 401
