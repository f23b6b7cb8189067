"""The tabs of a study: the same row on each of its pages, with the present one marked."""

import pytest
from django.contrib.auth.models import Permission
from django.urls import reverse

from experiments.models import Rehearsal
from experiments.research import analysis_cache
from experiments.research.analysis_cache import NotComputedError
from tests.support.browsers.html_page import read
from tests.support.people import person
from tests.support.sessions import replays
from tests.support.studies.members import member, signed_in

pytestmark = pytest.mark.django_db
ALL = [
    "Overview",
    "Builder",
    "Participants",
    "Live",
    "Drives and replay",
    "Coding",
    "Analysis",
    "Export",
    "Sharing",
]


@pytest.fixture
def drive(monkeypatch):
    """A drive of a study whose analysis cannot be computed but has a page."""

    def refuse(*_args):
        raise NotComputedError("not now")

    monkeypatch.setattr(analysis_cache, "report_for", refuse)
    robot = replays.cabin_robot()
    robot.presence.factsheet |= {
        "capabilities": ["velocity"],
        "limits": {"linear": 0.6, "angular": 0.7},
    }
    robot.presence.save()
    session = replays.session(robot, person("ada"), seconds=10)
    return replays.drive(replays.participant(replays.study(), session.visitor), session)


def pages(drive) -> dict[str, str]:
    """Return addresses of pages of a study, and the tab that each belongs to."""
    study, person_, rows = drive.participant.study, drive.participant, "?study="
    rehearsal = Rehearsal.objects.create(study=study, began_at=drive.granted_at)

    def admin(name, *args):
        return reverse(f"admin:experiments_{name}", args=args)

    return {
        admin("study_change", study.pk): "Overview",
        admin("study_publish", study.pk): "Overview",
        admin("rehearsal_changelist") + f"{rows}{study.pk}": "Overview",
        admin("rehearsal_change", rehearsal.pk): "Overview",
        admin("study_section", study.pk, "about"): "Builder",
        admin("study_section", study.pk, "steps"): "Builder",
        admin("study_part", study.pk, "courses", 0): "Builder",
        admin("participant_changelist") + f"{rows}{study.pk}": "Participants",
        admin("participant_change", person_.pk): "Participants",
        reverse("study_live", args=[study.slug]): "Live",
        admin("drive_changelist") + f"{rows}{study.pk}": "Drives and replay",
        admin("drive_change", drive.pk): "Drives and replay",
        admin("drive_exclude", drive.pk): "Drives and replay",
        reverse("replay", args=[drive.session_id]): "Drives and replay",
        reverse("study_coding", args=[study.slug]): "Coding",
        reverse("analysis", args=[study.slug]): "Analysis",
        reverse("analysis_export", args=[study.slug]): "Export",
        admin("study_links", study.pk): "Sharing",
        admin("study_hours", study.pk): "Sharing",
        admin("study_members", study.pk): "Sharing",
    }


def tabs(response) -> list[tuple[str, str, bool]]:
    """Return the first row of tabs of a page: what each says, its address, whether it is marked."""
    html = response.content.decode()
    start = html.find('<nav class="tabs"')
    if start < 0:
        return []
    response.content = f"<body>{html[start : html.index('</nav>', start)]}</nav></body>"
    return [
        (e.text.strip(), e.attributes["href"], e.attributes.get("aria-current") == "page")
        for e in read(response).all("a")
    ]


def test_every_page_of_a_study_has_the_same_tabs_and_its_own_is_marked(client, drive):
    client.force_login(person("boss", is_staff=True, is_superuser=True))
    rows = set()
    for address, mine in pages(drive).items():
        found = tabs(client.get(address))
        assert [text for text, _url, _is_here in found] == ALL, address
        assert [text for text, _url, is_here in found if is_here] == [mine], address
        rows.add(tuple(url for _text, url, _is_here in found))
    assert len(rows) == 1


@pytest.mark.parametrize("role", ["viewer", "researcher", "owner"])
def test_each_tab_that_a_researcher_sees_opens(client, drive, role):
    signed_in(client, role)
    for text, url, _is_here in tabs(client.get(reverse("study_live", args=["cabin-study"]))):
        assert client.get(url, follow=True).status_code in {200, 503}, text


def test_members_without_staff_status_see_only_tabs_outside_of_the_administration(client, drive):
    client.force_login(member("viewer"))
    found = tabs(client.get(reverse("study_live", args=["cabin-study"])))
    assert [text for text, _url, _is_here in found] == ["Live", "Coding", "Analysis", "Export"]


def test_a_list_of_all_studies_and_a_session_of_no_study_have_no_tabs(client, drive):
    client.force_login(person("boss", is_staff=True, is_superuser=True))
    other = replays.session(drive.session.robot, person("bert"), seconds=10)
    for address in (
        reverse("admin:experiments_participant_changelist"),
        reverse("admin:experiments_participant_changelist") + "?study=nothing",
        reverse("replay", args=[other.pk]),
    ):
        answer = client.get(address, follow=True)
        assert answer.status_code == 200
        assert tabs(answer) == []


def test_a_stranger_who_sees_sessions_sees_no_tabs_of_the_study(client, drive):
    user = person("guard", is_staff=True)
    user.user_permissions.set(Permission.objects.filter(codename="view_session"))
    client.force_login(user)
    answer = client.get(reverse("replay", args=[drive.session_id]))
    assert answer.status_code == 200
    assert tabs(answer) == []
