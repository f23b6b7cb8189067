"""Participants and drives in the administration."""

import pytest
from django.contrib.admin.models import LogEntry
from django.urls import reverse
from django.utils import timezone

from experiments import publishing
from experiments.models import Draw, Drive, Participant, Rehearsal
from robots.models import Robot
from sessions.models import Session
from tests.integration.experiments.test_publishing import NOW
from tests.support.browsers.html_page import read
from tests.support.people import person
from tests.support.studies.members import signed_in
from tests.support.studies.studies import small_study

pytestmark = pytest.mark.django_db
NAME, PID = "Anna B.", "p-77"  # with signs that no random token of a page has
PEOPLE, DRIVES = "admin:experiments_participant_changelist", "admin:experiments_drive_changelist"


@pytest.fixture
def drive():
    study = publishing.store(small_study(), NOW)
    robot = Robot.objects.create(name="giraff", title="Giraff")
    user = person("anna-b", display_name=NAME)
    arrival = {"slot": "a", "created_at": NOW, "seen_at": NOW, "recruitment": {"PROLIFIC_PID": PID}}
    cell = {"cell": "shut", "conditions": ["shut"]}
    participant = Participant.objects.create(study=study, user=user, **arrival, **cell)
    session = Session.objects.create(robot=robot, visitor=user, live_key="s", queued_at=NOW)
    place = {"step": "task", "visit": 1, "round": 0, "number": 1, "condition": "shut", "seed": 1}
    found = {"outcome": "completed", "exposed_at": NOW, "moved": True, "mismatches": ["assist"]}
    about = {"participant": participant, "session": session, "granted_at": NOW}
    return Drive.objects.create(**about, **place, **found)


def change(row) -> str:
    return reverse(f"admin:experiments_{row._meta.model_name}_change", args=[row.pk])


def exclude(row: Drive) -> str:
    return reverse("admin:experiments_drive_exclude", args=[row.pk])


def test_a_viewer_sees_codes_and_no_people(client, drive):
    signed_in(client, "viewer")
    for address in (reverse(PEOPLE), reverse(DRIVES), change(drive), change(drive.participant)):
        text = client.get(address).content.decode()
        assert drive.participant.code in text
        assert [word for word in (NAME, "anna-b", PID) if word in text] == []


def test_a_researcher_sees_the_participants_name(client, drive):
    signed_in(client, "researcher")
    page = read(client.get(change(drive.participant)))
    assert NAME in page.text
    assert change(drive) in [e.attributes.get("href") for e in page.all("a")]


def test_rows_of_other_studies_are_not_listed_shown_or_excluded(client, drive):
    signed_in(client, "owner", slug="another")
    for address in (reverse(PEOPLE), reverse(DRIVES)):
        assert drive.participant.code not in client.get(address).content.decode()
        assert client.get(address, {"study": str(drive.participant.study_id)}).status_code == 200
    assert {client.get(change(row)).status_code for row in (drive, drive.participant)} == {302}
    assert client.get(exclude(drive)).status_code == 404
    assert client.post(exclude(drive), {"reason": "Because."}).status_code == 404


def withdrawal(row) -> str:
    return reverse("admin:experiments_participant_withdraw", args=[row.pk])


def test_researcher_withdraws_a_participant_by_their_code_and_gets_the_receipt(client, drive):
    signed_in(client, "researcher")
    person_row = drive.participant
    links = read(client.get(change(person_row))).all("a")
    assert withdrawal(person_row) in [one.attributes.get("href") for one in links]
    answer = client.post(withdrawal(person_row), {"code": "WRONG"})
    assert (answer.status_code, Drive.objects.count()) == (422, 1)
    assert "This is not the participant's code." in read(answer).text
    page = read(client.post(withdrawal(person_row), {"code": person_row.code.lower()}))
    assert "Drives: 1" in page.text
    assert person_row.code in page.text
    (row,) = Participant.objects.filter(status="withdrawn")
    assert (row.user, row.recruitment) == (None, {})
    assert client.get(withdrawal(row)).status_code == 404


def test_withdrawing_is_for_researchers_and_owners_alone(client, drive):
    signed_in(client, "viewer")
    assert client.get(withdrawal(drive.participant)).status_code == 404
    assert client.post(withdrawal(drive.participant), {"code": "x"}).status_code == 404
    assert "Withdraw and delete data" not in read(client.get(change(drive.participant))).text


def test_participants_page_shows_every_draw(client, drive):
    signed_in(client, "viewer")
    study = drive.participant.study
    about = {"study": study, "participant": drive.participant, "kind": "participant", "at": NOW}
    first = {"reason": "first", "cell": "all_open", "counts": {"shut": 2}}
    Draw.objects.create(**about, number=1, nth=1, **first)
    Draw.objects.create(**about, number=2, nth=2, reason="again", cell="shut", seed=77)
    text = read(client.get(change(drive.participant))).text
    assert "all_open: first assignment; places taken: shut 2" in text
    assert "shut: assigned again" in text
    assert "seed 77" in text


def test_the_page_of_a_drive_has_units_and_times_instead_of_stored_numbers(client, drive):
    began = NOW.timestamp()
    Drive.objects.update(
        result={
            "outcome": "completed",
            "started": began,
            "ended": began + 727.46,
            "checkpoints": [began + 95.2, began + 301.0],
            "photo": "kept",
            "doors": ["lab-door"],
            "doors_missed": [],
            "dock_contacts": 1,
        },
        assigned={"condition": {"robot": "giraff", "speed": {"linear": 0.3, "angular": 0.5236}}},
        applied={"linear": 0.4, "angular": 0.187, "methods": ["keyboard"], "doors_closed": []},
        began_with={"docked": True, "x": 1.4, "y": 6.2, "theta": 1.5708, "charge": 0.9349},
        ended_with={"docked": False, "x": None, "y": None, "theta": None, "charge": None},
    )
    signed_in(client, "viewer")
    page = read(client.get(change(drive)))
    shown = "\n".join(e.text for e in page.all("li"))
    for text in (
        timezone.localtime(NOW).strftime("Task started: %Y-%m-%d %H:%M:%S %Z"),
        "Checkpoints passed after: 1:35 min, 5:01 min",
        "Doors driven through: lab-door",
        "Speed limits · Speed (m/s): 0.3",
        "Speed limits · Turning speed (°/s): 30",
        "Highest speed: 0.40 m/s",
        "Highest turning speed: 11°/s",
        "at the start · Battery charge: 93 %",
        "at the start · Direction: 90°",
        "at the start · Docked: yes",
        "at the end · Docked: no",
    ):
        assert text in shown
    assert timezone.localtime(NOW).strftime("Granted: %Y-%m-%d %H:%M:%S %Z") in page.text
    assert "Round: 1 Session number: 1" in page.text
    assert "e+09" not in shown
    assert f"{began:.0f}" not in shown
    assert drive.participant.code in page.all("h2")[0].text
    assert str(drive.participant_id) not in page.all("h2")[0].text


def test_a_rehearsal_shows_whether_it_is_of_the_current_definition(client, drive):
    signed_in(client, "viewer")
    study = drive.participant.study
    passed = {"status": Rehearsal.Status.DONE, "passed": True, "report": {"passed": True}}
    times = {"began_at": NOW, "finished_at": NOW}
    row = study.rehearsals.create(sha256=study.sha256, **times, **passed)
    assert "of the study as it is now" in read(client.get(change(row))).text
    rehearsals = reverse("admin:experiments_rehearsal_changelist")
    assert 'alt="True"' in client.get(rehearsals).content.decode()
    publishing.save_draft(study, small_study(title={"en": "Hut"}))
    assert 'alt="False"' in client.get(rehearsals).content.decode()


def test_participants_and_drives_cannot_be_edited(client, drive):
    client.force_login(person("boss", is_staff=True, is_superuser=True))
    for model in ("participant", "drive"):
        assert client.get(reverse(f"admin:experiments_{model}_add")).status_code == 403
    for row in (drive, drive.participant):
        assert client.post(change(row), {"code": "X"}).status_code == 403
        delete = reverse(f"admin:experiments_{row._meta.model_name}_delete", args=[row.pk])
        assert client.post(delete, {"post": "yes"}).status_code == 403


@pytest.mark.parametrize(
    ("name", "listed", "empty"),
    [
        ("condition", "shut", "all_open"),
        ("outcome", "completed", "timed_out"),
        ("applied", "no", "yes"),
        ("excluded", "no", "yes"),
        ("participant__kind__exact", "participant", "bot"),
        ("moved__exact", "1", "0"),
    ],
)
def test_drives_are_filtered(client, drive, name, listed, empty):
    signed_in(client, "viewer")
    for value, is_listed in ((listed, True), (empty, False)):
        page = client.get(reverse(DRIVES), {name: value}).content.decode()
        assert (drive.participant.code in page) == is_listed


@pytest.mark.parametrize(
    "asked",
    [
        "participant?recruitment__PROLIFIC_PID__startswith=p",
        "participant?age=33",
        "participant?user__id__startswith=0",
        "participant?consents=0",
        "participant?completion_code__startswith=0",
        "participant?study__secret__startswith=0",
        "drive?participant__user=0",
        "drive?participant__recruitment__PROLIFIC_PID=p-77",
        "drive?session__visitor__username=anna-b",
        "drive?seed=1",
        "rehearsal?report__minutes=12",
        "study?secret__startswith=0",
        "study?definition__slug=cabin-study",
        "study?participants__user__username=anna-b",
    ],
)
@pytest.mark.parametrize("role", ["viewer", "owner"])
def test_a_list_is_not_asked_for_what_it_does_not_show(client, drive, asked, role):
    signed_in(client, role)
    page, _mark, query = asked.partition("?")
    address = reverse(f"admin:experiments_{page}_changelist")
    assert client.get(address).status_code == 200
    assert client.get(f"{address}?{query}").status_code == 400


def test_participants_and_studies_are_filtered(client, drive):
    signed_in(client, "viewer")
    study = drive.participant.study_id
    for page, query, count in (
        ("participant", {"study": study, "kind__exact": "participant"}, 1),
        ("participant", {"kind__exact": "bot"}, 0),
        ("participant", {"created_at__year": NOW.year}, 1),
        ("study", {"status__exact": "draft"}, 1),
        ("drive", {"study": study}, 1),
        ("drive", {"study": "nonsense"}, 0),
        ("rehearsal", {"study": study}, 0),
    ):
        answer = client.get(reverse(f"admin:experiments_{page}_changelist"), query)
        assert answer.context["cl"].result_count == count, query


def test_a_drive_is_excluded_and_included_again_with_reasons_on_record(client, drive):
    user = signed_in(client, "researcher")
    assert "Exclude" in read(client.get(change(drive))).text
    client.post(exclude(drive), {"exclude": "1", "reason": "The camera was covered."})
    row = Drive.objects.get()
    assert (row.excluded_reason, row.excluded_by) == ("The camera was covered.", user)
    assert "The camera was covered." in read(client.get(change(drive))).text
    excluded = client.get(reverse(DRIVES), {"excluded": "yes"}).content.decode()
    assert drive.participant.code in excluded
    client.post(exclude(drive), {"include": "1", "reason": "It was not."})
    row = Drive.objects.get()
    assert (row.excluded_reason, row.excluded_by, row.excluded_at) == ("", None, None)
    entries = LogEntry.objects.filter(user=user).order_by("action_time", "pk")
    assert [entry.change_message for entry in entries] == [
        "Excluded: The camera was covered.",
        "Not excluded any more: It was not. (was: The camera was covered.)",
    ]


@pytest.mark.parametrize("reason", ["", "  ", "no", "x" * 301])
def test_excluding_needs_a_reason(client, drive, reason):
    signed_in(client, "researcher")
    answer = client.post(exclude(drive), {"exclude": "1", "reason": reason})
    assert "Enter a reason" in read(answer).text
    assert Drive.objects.get().excluded_reason == ""


def test_a_viewer_excludes_nothing(client, drive):
    signed_in(client, "viewer")
    assert exclude(drive) not in client.get(change(drive)).content.decode()
    assert client.post(exclude(drive), {"exclude": "1", "reason": "Because."}).status_code == 404
