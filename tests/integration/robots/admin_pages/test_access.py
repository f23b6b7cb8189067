"""What an owner finds in the administration: their own robot, and nothing about who drove it."""

import pytest
from django.contrib.auth.models import Permission
from django.urls import reverse

from robots.models import FloorPlan, Robot
from sessions import system_log
from sessions.models import Lease, Session, SessionEvent
from tests.support.people import person
from tests.support.robots import create_robot
from tests.support.sessions import replays

pytestmark = pytest.mark.django_db
SECRETS = ("Zaphod", "zaphod", "198.51.100.0", "Mozilla", "told by the page")


@pytest.fixture
def owner(client):
    user = person("owner", is_staff=True)
    client.force_login(user)
    return user


@pytest.fixture
def robot(owner):
    return replays.cabin_robot(owner=owner)


@pytest.fixture
def driven(robot):
    device = {
        "os": "Linux",
        "browser": "Firefox",
        "network": "198.51.100.0/24",
        "user_agent": "Mozilla/5.0",
    }
    row = replays.session(
        robot,
        person("zaphod", display_name="Zaphod", email="zaphod@example.org"),
        seconds=60,
        device=device,
    )
    SessionEvent.objects.create(
        session=row,
        source="page",
        type="said",
        stamp=1.0,
        received_at=1.0,
        data={"text": "told by the page"},
    )
    Lease.objects.create(robot=robot, session=row, peer="p-4711", changed_at=row.granted_at)
    system_log.log("session_ended", robot=robot, session=row)
    return row


def test_an_owner_changes_all_of_a_robot_but_whose_it_is_and_where(client, robot, owner):
    other, elsewhere = (
        person("other"),
        FloorPlan.objects.create(
            name="attic",
            title="Attic",
            resolution=0.05,
            origin_x=0.0,
            origin_y=0.0,
            width=1,
            height=1,
            image=b"",
            sha256="",
        ),
    )
    form = {
        "title": "Mine",
        "description": "",
        "enabled": "on",
        "access": "trained",
        "assist": "off",
        "calls": "ask",
        "charge_limit": "0.2",
        "owner": str(other.pk),
        "floor_plan": str(elsewhere.pk),
        "name": "renamed",
        "permits-TOTAL_FORMS": "0",
        "permits-INITIAL_FORMS": "0",
        "permits-MIN_NUM_FORMS": "0",
        "permits-MAX_NUM_FORMS": "1000",
    }
    assert (
        client.post(reverse("admin:robots_robot_change", args=[robot.pk]), form).status_code == 302
    )
    changed = Robot.objects.get(pk=robot.pk)
    assert (changed.title, changed.access, changed.calls) == ("Mine", "trained", "ask")
    assert (changed.owner, changed.floor_plan.name, changed.name) == (owner, "cabin", "giraff")
    owner.user_permissions.add(Permission.objects.get(codename="view_robot"))
    assert (
        client.post(
            reverse("admin:robots_robot_change", args=[robot.pk]), form | {"title": "Ours"}
        ).status_code
        == 302
    )
    changed.refresh_from_db()
    assert (changed.title, changed.owner, changed.floor_plan.name) == ("Ours", owner, "cabin"), (
        "a right to look gives nothing away"
    )


@pytest.mark.parametrize(
    "page",
    [
        "session_changelist",
        "session_change",
        "session_history",
        "systemlog_changelist",
        "lease_changelist",
    ],
)
def test_an_owner_reads_that_the_robot_was_driven_and_not_by_whom(client, driven, page):
    args = [driven.pk] if page in {"session_change", "session_history"} else []
    html = client.get(reverse(f"admin:telepresence_sessions_{page}", args=args)).content.decode()
    assert "Giraff" in html
    assert [word for word in SECRETS if word in html] == []


@pytest.mark.parametrize(
    "page",
    [
        "robots_robot_changelist",
        "robots_robot_change",
        "telepresence_sessions_lease_changelist",
        "telepresence_sessions_lease_change",
    ],
)
def test_an_owner_reads_that_somebody_drives_and_who_sees_all_reads_who(
    client, driven, robot, page
):
    address = reverse(f"admin:{page}", args=[robot.pk] if page.endswith("_change") else [])
    html = client.get(address).content.decode()
    assert ">someone<" in html
    assert [word for word in SECRETS if word in html] == []
    assert ">alguien<" in client.get(address, headers={"accept-language": "es"}).content.decode()
    client.force_login(person("boss", is_staff=True, is_superuser=True))
    assert ">Zaphod<" in client.get(address).content.decode()


@pytest.mark.parametrize(
    "asked",
    [
        "telepresence_sessions_session?device__network=198.51.100.0/24",
        "telepresence_sessions_session?device__user_agent__startswith=M",
        "telepresence_sessions_session?visitor__id__startswith=0",
        "telepresence_sessions_session?live_key__startswith=0",
        "telepresence_sessions_session?terms__study=cabin-study",
        "telepresence_sessions_session?events=0",
        "telepresence_sessions_lease?peer__startswith=p",
        "telepresence_sessions_lease?session__visitor__username=zaphod",
        "telepresence_sessions_systemlog?session__visitor__id=0",
        "telepresence_sessions_apikey?token_hash__startswith=p",
        "robots_robot?credential_hash__startswith=p",
        "robots_robot?permits__user__username=zaphod",
        "robots_floorplan?sha256__startswith=0",
    ],
)
@pytest.mark.parametrize(
    "rights",
    [
        [],
        [
            "view_session",
            "view_lease",
            "view_systemlog",
            "view_apikey",
            "view_robot",
            "view_floorplan",
        ],
    ],
)
def test_a_list_is_not_asked_for_what_it_does_not_show(client, owner, driven, asked, rights):
    owner.user_permissions.set(Permission.objects.filter(codename__in=rights))
    page, _mark, query = asked.partition("?")
    address = reverse(f"admin:{page}_changelist")
    assert client.get(address).status_code == 200
    assert client.get(f"{address}?{query}").status_code == 400


def test_an_owner_filters_and_follows_the_links_of_the_site(client, driven, robot):
    for page, lookup, value in (
        ("telepresence_sessions_session", "robot__id__exact", robot.pk),
        ("telepresence_sessions_session", "state__exact", driven.state),
        ("telepresence_sessions_session", "queued_at__year", driven.queued_at.year),
        ("telepresence_sessions_systemlog", "level__exact", "info"),
        ("robots_robot", "floor_plan__id__exact", robot.floor_plan_id),
        ("robots_robot", "enabled__exact", "1"),
    ):
        assert (
            client.get(reverse(f"admin:{page}_changelist"), {lookup: value})
            .context["cl"]
            .result_count
            == 1
        ), lookup
    assert (
        f"?robot__id__exact={robot.pk}"
        in client.get(reverse("admin:robots_robot_change", args=[robot.pk])).content.decode()
    )
    assert (
        f"?floor_plan__id__exact={robot.floor_plan_id}"
        in client.get(reverse("admin:robots_floorplan_changelist")).content.decode()
    )


def test_an_owner_finds_no_session_by_what_they_know_of_a_visitor(client, driven):
    address = reverse("admin:telepresence_sessions_session_changelist")
    for question in ({"q": "zaphod"}, {"q": "zaphod@example.org"}):
        assert not client.get(address, question).context["cl"].queryset.exists()
    for lookup in ("visitor__username", "visitor__email__startswith"):
        assert client.get(address, {lookup: "zaphod"}).status_code in {302, 400}


@pytest.mark.parametrize("action", ["download_csv", "download_json"])
def test_an_owner_takes_no_record_away(client, driven, action):
    answer = client.post(
        reverse("admin:telepresence_sessions_session_changelist"),
        {"action": action, "_selected_action": [driven.pk]},
        follow=True,
    )
    assert answer.headers.get("Content-Disposition") is None


@pytest.mark.parametrize("rights", [[], ["view_robot"]])
def test_an_owner_acts_on_no_robot_of_others_whatever_is_sent(client, owner, robot, rights):
    owner.user_permissions.set(Permission.objects.filter(codename__in=rights))
    theirs = create_robot(
        name="rhodon",
        title="Rhodon",
        owner=person("other"),
        credential_hash="kept",
        turnaround="paused",
    )
    off = Robot.objects.create(name="tiago", title="Tiago", enabled=False)
    for action in ("disable", "rotate_credentials", "revoke_credentials", "free"):
        client.post(
            reverse("admin:robots_robot_changelist"),
            {"action": action, "_selected_action": [theirs.pk, robot.pk]},
        )
    client.post(
        reverse("admin:robots_robot_changelist"), {"action": "enable", "_selected_action": [off.pk]}
    )
    theirs.refresh_from_db()
    assert (
        theirs.enabled,
        theirs.credentials.credential_hash,
        theirs.credentials.renewal_asked_at,
        theirs.presence.turnaround,
    ) == (
        True,
        "kept",
        None,
        "paused",
    )
    assert dict(Robot.objects.values_list("name", "enabled")) == {
        "giraff": False,
        "rhodon": True,
        "tiago": False,
    }


def test_users_with_permission_to_change_robots_act_on_all_of_them(client, robot):
    operator = person("operator", is_staff=True)
    operator.user_permissions.add(Permission.objects.get(codename="change_robot"))
    client.force_login(operator)
    client.post(
        reverse("admin:robots_robot_changelist"),
        {"action": "disable", "_selected_action": [robot.pk]},
    )
    assert not Robot.objects.get(pk=robot.pk).enabled


def test_an_owner_stops_a_session_on_their_robot_and_on_no_other(client, owner, robot):
    here = replays.session(robot, person("ada"))
    elsewhere = replays.session(Robot.objects.create(name="rhodon", title="Rhodon"), person("ben"))
    chosen = {"action": "stop_sessions", "_selected_action": [here.pk, elsewhere.pk]}
    client.post(reverse("admin:telepresence_sessions_session_changelist"), chosen)
    assert dict(Session.objects.values_list("visitor__username", "state")) == {
        "ada": "ended",
        "ben": "driving",
    }
