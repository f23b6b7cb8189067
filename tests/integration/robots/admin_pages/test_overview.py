"""The top of a robot's page: its state, how to start it, its sessions; and when visitors see it."""

import datetime
import re
from html import unescape

import pytest
from django.contrib.auth.models import Permission
from django.urls import reverse
from django.utils import timezone

from accounts.models import AuditEntry
from experiments.models import Study, StudyMember
from robots.access import may_drive, robots_visible_to
from robots.enrol.credentials import make_credentials
from robots.enrol.tokens import redeem
from robots.models import Robot, RobotPresence
from robots.screens import make_screen_key
from tests.support.people import person
from tests.support.robots import robot_form, update_robots
from tests.support.sessions import replays

pytestmark = pytest.mark.django_db
ADD = "/admin/robots/robot/add/"
NEW = robot_form(name="lab")
KIND = {"adapter": "ros1", "profile": "giraff"}


def address(robot, page="change"):
    return reverse(f"admin:robots_robot_{page}", args=[robot.pk])


def overview(client, robot):
    text = unescape(client.get(address(robot)).content.decode())
    return re.search(r'<section id="robot-overview".*?</section>', text, re.DOTALL)[0]


def checkbox(client, robot):
    text = client.get(address(robot)).content.decode()
    return re.search(r'<input[^>]*name="shown_to_visitors"[^>]*>', text)[0]


@pytest.fixture
def boss(client):
    user = person("boss", is_staff=True, is_superuser=True)
    client.force_login(user)
    return user


@pytest.fixture
def owner(client):
    user = person("owner", is_staff=True)
    client.force_login(user)
    return user


@pytest.fixture
def robot(owner):
    return replays.cabin_robot(owner=owner, shown_to_visitors=False)


def seen(robot):
    now = timezone.now()
    RobotPresence.objects.filter(pk=robot.pk).update(connection="ONLINE", last_seen_at=now)


@pytest.mark.nightly
def test_top_of_the_page_links_to_the_robots_other_pages(client, robot):
    text = client.get(address(robot)).content.decode()
    tools = re.search(r'<ul class="object-tools">.*?</ul>', text, re.DOTALL)[0]
    for page in ("credentials", "screen", "doors"):
        assert f'href="{address(robot, page)}"' in tools
        assert client.get(address(robot, page)).status_code == 200


def test_new_robot_is_hidden_and_its_page_shows_how_to_connect_it(client, boss):
    answer = client.post(ADD, NEW | {"shown_to_visitors": "on"})
    robot = Robot.objects.get()
    assert answer["Location"] == address(robot)
    assert not robot.shown_to_visitors
    assert not robots_visible_to(person("ada")).exists()
    text = overview(client, robot)
    assert "Waiting for the robot to connect…" in text
    assert "Create the command" in text


def test_form_of_a_new_robot_has_no_reported_fields(client, boss):
    text = client.get(ADD).content.decode()
    reported = ("online_now", "battery", "docked", "driver", "reported_state")
    for field in (*reported, "shown_to_visitors"):
        assert f"field-{field}" not in text
    assert "field-title" in text
    assert "field-adapter" in text


def test_form_of_a_robot_has_no_inputs_for_its_state(client, robot):
    text = client.get(address(robot)).content.decode()
    names = set(re.findall(r'<(?:input|select|textarea)[^>]*\sname="(\w+)"', text))
    assert not names & {"connection", "online", "docked", "battery", "report", "last_seen_at"}


def test_robot_can_be_shown_once_it_was_online_and_hidden_again(client, robot):
    form, visitor = NEW | {"shown_to_visitors": "on"}, person("visitor")
    assert "disabled" in checkbox(client, robot)
    refused = client.post(address(robot), form).content.decode()
    assert "Connect it, then show it to visitors." in unescape(refused)
    seen(robot)
    assert "disabled" not in checkbox(client, robot)
    for wanted in (form, NEW, form):
        assert client.post(address(robot), wanted).status_code == 302
        robot.refresh_from_db()
        assert robot.shown_to_visitors is ("shown_to_visitors" in wanted)
        assert robots_visible_to(visitor).exists() is robot.shown_to_visitors


def test_robot_that_was_shown_before_it_was_online_stays_shown(client, robot):
    Robot.objects.update(shown_to_visitors=True)
    assert "disabled" not in checkbox(client, robot)
    assert client.post(address(robot), NEW | {"shown_to_visitors": "on"}).status_code == 302
    assert Robot.objects.get().shown_to_visitors


def test_list_marks_a_hidden_robot(client, robot):
    assert ">hidden<" in client.get(reverse("admin:robots_robot_changelist")).content.decode()


def test_owner_drives_a_hidden_robot(robot, owner):
    assert may_drive(owner, robot)
    assert may_drive(person("ada"), robot).reason == "disabled"


def test_question_about_a_display_disappears_with_a_screen_key(client, robot):
    seen(robot)
    assert "Does the robot have a display?" in overview(client, robot)
    make_screen_key(robot, timezone.now())
    assert "Does the robot have a display?" not in overview(client, robot)


def test_overview_shows_state_command_battery_versions_and_sessions_in_this_order(
    client, robot, owner
):
    make_credentials(robot, timezone.now())
    update_robots(**KIND)
    seen(robot)
    RobotPresence.objects.update(
        report={"battery": {"charge": 0.5}},
        factsheet=robot.presence.factsheet | {"agentVersion": "0.9.1"},
    )
    replays.session(robot, person("zaphod", display_name="Zaphod"), seconds=90)
    text = overview(client, robot)
    parts = (
        "Ready, but hidden from visitors.",
        "telepresence run_robot giraff --server http://testserver",
        "50 %",
        "0.9.1",
        "version 1",
        ">1.5<",
        ">completed<",
        "img/robots/giraff",
        "No: the owner's account has no e-mail address.",
    )
    places = [text.find(part) for part in parts]
    assert -1 not in places
    assert places == sorted(places)
    assert "Waiting for the robot" not in text


def test_command_with_a_token_is_shown_once(client, robot, owner):
    assert "--enrol" not in client.get(address(robot, "enrol")).content.decode()
    answer = client.post(address(robot, "enrol"), KIND)
    text = unescape(answer.content.decode())
    command = re.search(r'<pre id="command"[^>]*>(.*?)</pre>', text, re.DOTALL)[1]
    token = re.search(r"--enrol ([\w-]+)", command)[1]
    assert "This command is shown only once." in text
    assert f'action="{address(robot)}"' in text
    assert "no-store" in answer["Cache-Control"]
    assert token not in client.get(address(robot)).content.decode()
    assert AuditEntry.objects.get(act="enrolment_made").actor == owner.pk
    assert token not in str(list(AuditEntry.objects.values()))
    assert command.startswith("telepresence run_robot giraff --server http://")
    assert "--adapter ros1 --profile giraff" in command
    assert redeem("giraff", token, timezone.now()) is not None
    assert "--enrol" not in overview(client, robot)
    assert "run_robot giraff" in overview(client, robot)


def enrolled(client, robot, **kind):
    text = unescape(client.post(address(robot, "enrol"), KIND | kind).content.decode())
    found = re.search(r'<pre id="command"[^>]*>(.*?)</pre>', text, re.DOTALL)
    return text if found is None else re.sub("<.*?>", "", found[1]).partition(" --enrol")[0]


def test_command_has_the_options_of_the_chosen_software_only(client, robot):
    chosen = {"ros1-master": "http://10.0.0.2:11311", "moos-host": "10.0.0.9", "ros1-ip": ""}
    assert enrolled(client, robot, **chosen).endswith(
        "--adapter ros1 --profile giraff --option master=http://10.0.0.2:11311"
    )
    again = client.get(address(robot, "enrol")).content.decode()
    assert 'value="http://10.0.0.2:11311"' in again
    assert enrolled(client, robot, adapter="moos").endswith("--adapter moos --profile giraff")


def test_command_quotes_what_a_shell_would_read(client, robot):
    command = enrolled(client, robot, **{"ros1-master": "http://a;reboot $(id)"})
    assert "--option 'master=http://a;reboot $(id)'" in command


def test_command_needs_software_and_model(client, robot):
    for missing in ("adapter", "profile"):
        assert "This field is required." in enrolled(client, robot, **{missing: ""})
    assert not Robot.objects.get().enrolments.exists()
    command = enrolled(
        client,
        robot,
        adapter="other",
        adapter_other="acme",
        profile="other",
        profile_other="a.toml",
    )
    assert command.endswith("--adapter acme --profile a.toml")


def test_form_proposes_what_the_robot_connected_with(client, robot):
    RobotPresence.objects.update(factsheet={"series": "rhodon", "adapter": "ros2 0.9"})
    text = overview(client, robot)
    assert '<option value="ros2" selected>' in text
    assert '<option value="rhodon" selected>' in text


@pytest.mark.parametrize(
    ("host", "warning"),
    [
        ("127.0.0.1:8000", "This address works on this computer only."),
        ("localhost", "This address works on this computer only."),
        ("testserver", "The robot's computer refuses this address."),
    ],
)
def test_page_warns_of_an_address_that_the_robots_computer_cannot_use(client, robot, host, warning):
    text = unescape(client.get(address(robot), HTTP_HOST=host).content.decode())
    assert warning in text
    secure = client.get(address(robot), HTTP_HOST="testserver", secure=True).content.decode()
    assert "overview__warning" not in secure


def test_owner_rotates_the_credentials(client, robot, owner):
    make_credentials(robot, timezone.now())
    action = {"action": "rotate_credentials", "_selected_action": [robot.pk]}
    client.post(reverse("admin:robots_robot_changelist"), action)
    assert Robot.objects.get().credentials.renewal_asked_at is not None
    assert AuditEntry.objects.get(act="rotation_asked").actor == owner.pk


def test_user_who_may_only_view_the_robot_gets_no_command(client, robot):
    client.force_login(viewer := person("viewer", is_staff=True))
    viewer.user_permissions.add(Permission.objects.get(codename="view_robot"))
    assert "Create the command" not in overview(client, robot)
    assert client.post(address(robot, "enrol")).status_code == 403


def test_last_ten_sessions_have_names_and_replays_for_superusers_only(client, robot):
    for day in range(12):
        visitor = person(f"zaphod{day}", display_name=f"Zaphod {day}")
        granted = replays.GRANTED + datetime.timedelta(days=day)
        replays.session(robot, visitor, granted=granted, seconds=60)
    text = overview(client, robot)
    assert text.count(">someone<") == 10
    assert "Zaphod" not in text
    assert "/studies/replay/" not in text
    assert text.count("/admin/telepresence_sessions/session/") == 11  # ten, and the list of all
    client.force_login(person("boss", is_staff=True, is_superuser=True))
    text = overview(client, robot)
    assert re.findall(r">Zaphod (\d+)<", text) == [str(day) for day in range(11, 1, -1)]
    assert text.count("/studies/replay/") == 10


def test_overview_tells_a_researcher_when_they_get_mail_about_the_robot(client, robot, owner):
    owner.email = "owner@example.org"
    owner.save()
    assert "No. Only researchers of a published study" in overview(client, robot)
    study = replays.study(status=Study.Status.PUBLISHED)
    assert "No. Only researchers" in overview(client, robot)
    StudyMember.objects.create(slug=study.slug, user=owner, role=StudyMember.Role.RESEARCHER)
    expected = "Yes, when the robot can't get ready, as a researcher of: Cabin."
    assert expected in overview(client, robot)


def test_status_changes_when_the_robot_connects(client, robot):
    before = client.get(address(robot, "status")).json()
    assert (before["connected"], before["tone"], before["agent"]) == (False, "off", "")
    seen(robot)
    after = client.get(address(robot, "status")).json()
    assert (after["connected"], after["label"]) == (True, "Hidden")


@pytest.mark.parametrize(
    "changes",
    [
        {"last_seen_at": None, "connection": "OFFLINE"},
        {"connection": "OFFLINE"},
        {"enabled": False},
        {"shown_to_visitors": True},
        {"report": {"safety": {"estop": True}}},
        {"turnaround": "charging", "turnaround_reason": "charging"},
    ],
)
def test_overview_and_settings_show_the_same_state(client, robot, changes):
    seen(robot)
    update_robots(**changes)
    status = client.get(address(robot, "status")).json()
    text = unescape(client.get(address(robot)).content.decode())
    shown = {
        name: re.search(rf'field-{name}\b.*?class="readonly">(.*?)</div>', text, re.DOTALL)[1]
        for name in status["fields"]
    }
    assert shown["between"].partition(":")[0] == status["label"]
    assert f"<strong data-label>{status['label']}</strong>" in text
    assert shown.pop("key").startswith(f"<span data-state>{status['fields'].pop('key')}</span>")
    assert shown == status["fields"]


def test_settings_show_since_when_a_robot_is_not_ready_and_why(client, robot):
    seen(robot)
    at = datetime.datetime(2026, 3, 1, 11, 0, tzinfo=datetime.UTC)
    update_robots(
        turnaround="paused", turnaround_reason="not_docked", turnaround_at=at, returns_home=True
    )
    between = client.get(address(robot, "status")).json()["fields"]["between"]
    assert between.startswith("Not ready: it is not docked (since 2026-03-01 ")


def test_status_reports_that_the_pages_token_was_used(client, robot):
    def made():
        text = client.post(address(robot, "enrol"), KIND).content.decode()
        token = re.search(r"--enrol ([\w-]+)", text)[1]
        return token, re.search(r'data-enrolment="([^"]+)"', text)[1]

    def status():
        answer = client.get(address(robot, "status")).json()
        return answer["enrolment"], answer["enrolled"]

    token, enrolment = made()
    assert status() == (enrolment, False)
    assert redeem("giraff", token, timezone.now()) is not None
    assert status() == ("", True)
    assert "data-enrolment" not in overview(client, robot)
    _again, another = made()
    assert status() == (another, True)
    assert enrolment != another


def test_status_is_visible_only_to_users_who_may_see_the_robot(client, robot):
    client.force_login(person("other", is_staff=True))
    assert client.get(address(robot, "status")).status_code == 404
    client.logout()
    assert client.get(address(robot, "status")).status_code == 302
