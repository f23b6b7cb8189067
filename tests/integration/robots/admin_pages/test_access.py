"""An owner's administration shows their robots, and nothing about the visitors who drove them."""

import pytest
from django.contrib.auth.models import Permission
from django.urls import reverse

from robots.models import Robot
from sessions import system_log
from sessions.models import Lease, Session, SessionEvent
from tests.support.people import person
from tests.support.robots import create_robot, floor_plan, robot_form
from tests.support.sessions import replays

pytestmark = pytest.mark.django_db
SECRETS = ("Zaphod", "zaphod", "198.51.100.0", "Mozilla", "written on the page")


@pytest.fixture
def owner(client):
    user = person("owner", is_staff=True)
    client.force_login(user)
    return user


@pytest.fixture
def robot(owner):
    return replays.cabin_robot(owner=owner)


def act(client, model, action, *rows):
    chosen = {"action": action, "_selected_action": [row.pk for row in rows]}
    return client.post(reverse(f"admin:{model}_changelist"), chosen, follow=True)


@pytest.fixture
def past_session(robot):
    device = {"os": "Linux", "network": "198.51.100.0/24", "user_agent": "Mozilla/5.0"}
    zaphod = person("zaphod", display_name="Zaphod", email="zaphod@example.org")
    row = replays.session(robot, zaphod, seconds=60, device=device)
    event = {"source": "page", "type": "said", "data": {"text": "written on the page"}}
    SessionEvent.objects.create(session=row, stamp=1.0, received_at=1.0, **event)
    Lease.objects.create(robot=robot, session=row, peer="p-4711", changed_at=row.granted_at)
    system_log.log("session_ended", robot=robot, session=row)
    return row


def test_owner_changes_a_robot_except_its_owner_name_and_floor_plan(client, robot, owner):
    form = robot_form(title="Mine", access="trained", calls="ask", name="renamed")
    form |= {"owner": str(person("other").pk), "floor_plan": str(floor_plan("attic").pk)}
    address = reverse("admin:robots_robot_change", args=[robot.pk])
    assert client.post(address, form).status_code == 302
    changed = Robot.objects.get(pk=robot.pk)
    assert (changed.title, changed.access, changed.calls) == ("Mine", "trained", "ask")
    assert (changed.owner, changed.floor_plan.name, changed.name) == (owner, "cabin", "giraff")
    owner.user_permissions.add(Permission.objects.get(codename="view_robot"))
    assert client.post(address, form | {"title": "Ours"}).status_code == 302
    changed.refresh_from_db()
    assert (changed.title, changed.owner, changed.floor_plan.name) == ("Ours", owner, "cabin")


@pytest.mark.parametrize(
    "page",
    ["session_change", "session_history"]
    + [f"{model}_changelist" for model in ("session", "systemlog", "lease")],
)
def test_owner_sees_sessions_without_their_visitors(client, past_session, page):
    args = [past_session.pk] if page in {"session_change", "session_history"} else []
    html = client.get(reverse(f"admin:telepresence_sessions_{page}", args=args)).content.decode()
    assert "Giraff" in html
    assert [word for word in SECRETS if word in html] == []


@pytest.mark.parametrize("view", ["changelist", "change"])
@pytest.mark.parametrize("model", ["robots_robot", "telepresence_sessions_lease"])
def test_only_superusers_see_the_name_of_the_driver(client, past_session, robot, model, view):
    address = reverse(f"admin:{model}_{view}", args=[robot.pk] if view == "change" else [])
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
    ["", "view_session view_lease view_systemlog view_apikey view_robot view_floorplan"],
)
def test_list_cannot_be_filtered_by_hidden_fields(client, owner, past_session, asked, rights):
    owner.user_permissions.set(Permission.objects.filter(codename__in=rights.split()))
    page, _mark, query = asked.partition("?")
    address = reverse(f"admin:{page}_changelist")
    assert client.get(address).status_code == 200
    assert client.get(f"{address}?{query}").status_code == 400


def test_owner_uses_the_filters_of_the_site(client, past_session, robot):
    for page, lookup, value in (
        ("telepresence_sessions_session", "robot__id__exact", robot.pk),
        ("telepresence_sessions_session", "state__exact", past_session.state),
        ("telepresence_sessions_session", "queued_at__year", past_session.queued_at.year),
        ("telepresence_sessions_systemlog", "level__exact", "info"),
        ("robots_robot", "floor_plan__id__exact", robot.floor_plan_id),
        ("robots_robot", "enabled__exact", "1"),
    ):
        answer = client.get(reverse(f"admin:{page}_changelist"), {lookup: value})
        assert answer.context["cl"].result_count == 1, lookup
    text = client.get(reverse("admin:robots_robot_change", args=[robot.pk])).content.decode()
    assert f"?robot__id__exact={robot.pk}" in text
    text = client.get(reverse("admin:robots_floorplan_changelist")).content.decode()
    assert f"?floor_plan__id__exact={robot.floor_plan_id}" in text


def test_owner_cannot_search_sessions_by_visitor(client, past_session):
    address = reverse("admin:telepresence_sessions_session_changelist")
    for question in ({"q": "zaphod"}, {"q": "zaphod@example.org"}):
        assert not client.get(address, question).context["cl"].queryset.exists()
    for lookup in ("visitor__username", "visitor__email__startswith"):
        assert client.get(address, {lookup: "zaphod"}).status_code in {302, 400}


@pytest.mark.parametrize("action", ["download_csv", "download_json"])
def test_owner_cannot_download_records(client, past_session, action):
    answer = act(client, "telepresence_sessions_session", action, past_session)
    assert answer.headers.get("Content-Disposition") is None


@pytest.mark.parametrize("rights", [[], ["view_robot"]])
def test_owner_cannot_act_on_robots_of_others(client, owner, robot, rights):
    owner.user_permissions.set(Permission.objects.filter(codename__in=rights))
    state = {"credential_hash": "kept", "turnaround": "paused"}
    theirs = create_robot(name="rhodon", title="Rhodon", owner=person("other"), **state)
    off = Robot.objects.create(name="tiago", title="Tiago", enabled=False)
    for action in ("disable", "rotate_credentials", "revoke_credentials", "free"):
        act(client, "robots_robot", action, theirs, robot)
    act(client, "robots_robot", "enable", off)
    theirs.refresh_from_db()
    stored = theirs.credentials
    assert (stored.credential_hash, stored.renewal_asked_at) == ("kept", None)
    assert theirs.presence.turnaround == "paused"
    enabled = {"giraff": False, "rhodon": True, "tiago": False}
    assert dict(Robot.objects.values_list("name", "enabled")) == enabled


def test_users_with_permission_to_change_robots_act_on_all_of_them(client, robot):
    operator = person("operator", is_staff=True)
    operator.user_permissions.add(Permission.objects.get(codename="change_robot"))
    client.force_login(operator)
    act(client, "robots_robot", "disable", robot)
    assert not Robot.objects.get(pk=robot.pk).enabled


def test_owner_stops_sessions_only_on_their_robot(client, owner, robot):
    here = replays.session(robot, person("ada"))
    elsewhere = replays.session(Robot.objects.create(name="rhodon", title="Rhodon"), person("ben"))
    act(client, "telepresence_sessions_session", "stop_sessions", here, elsewhere)
    states = {"ada": "ended", "ben": "driving"}
    assert dict(Session.objects.values_list("visitor__username", "state")) == states
