"""One-time tokens and renewed credentials, on the server and in an agent."""

import datetime
import io
import json
import stat
import sys
import tomllib
from pathlib import Path

import pytest
from django.core.management import CommandError, call_command
from django.utils import timezone

from accounts.models import AuditEntry
from robots.agent.agent import agent_of
from robots.agent.broker_link import enrolment as agent_side
from robots.agent.broker_link.broker_discovery import ServerAwayError
from robots.agent.config import ConfigError, load
from robots.broker.users import users_now
from robots.enrol import credentials
from robots.enrol.credentials import (
    GRACE,
    ask_for_renewal,
    make_credentials,
    revoke,
    robot_of,
    rotate,
    users_of,
)
from robots.enrol.tokens import make_token, redeem
from robots.management.commands import run_robot
from robots.models import Enrolment, Robot
from robots.process import log_ids
from tests.support.sessions.permitted import may_publish

pytestmark = pytest.mark.django_db
ENROL, RENEW = "/api/v1/agent/enrol/", "/api/v1/agent/renew/"


@pytest.fixture
def robot():
    return Robot.objects.create(name="giraff", title="Giraff")


def robots_at_the_broker():
    return [user for user in users_now().values() if not user.name.startswith("server.")]


def at_the_broker() -> dict[str, str]:
    return {user.name: user.credential_hash for user in robots_at_the_broker()}


def test_token_works_once_for_its_robot(robot):
    Robot.objects.create(name="rhodon", title="Rhodon")
    token, now = make_token(robot, timezone.now()), timezone.now()
    assert redeem("rhodon", token, now) is None
    made = redeem("giraff", token, now)
    assert robot_of("giraff", made.token) == robot
    assert redeem("giraff", token, now) is None


def test_token_expires_and_is_replaced_by_a_newer_one(robot):
    now = timezone.now()
    old = make_token(robot, now, hours=1)
    assert redeem("giraff", old, now + datetime.timedelta(hours=2)) is None
    newer = make_token(robot, now, hours=1)
    assert redeem("giraff", old, now) is None
    assert redeem("giraff", newer, now) is not None


def test_only_the_hash_of_a_token_is_stored(robot):
    token = make_token(robot, timezone.now())
    assert token not in str(Enrolment.objects.values().get())


def test_revoking_and_disabling_end_an_unused_token(robot):
    token = make_token(robot, timezone.now())
    Robot.objects.update(enabled=False)
    assert redeem("giraff", token, timezone.now()) is None
    Robot.objects.update(enabled=True)
    revoke(robot)
    assert redeem("giraff", token, timezone.now()) is None


def rotated(robot):
    """Return credentials of a robot, and those that replaced them."""
    old = make_credentials(robot, timezone.now())
    return old, rotate(robot, old.token, timezone.now())


def test_old_credentials_are_valid_beside_the_new_ones_for_a_while(robot):
    old, new = rotated(robot)
    assert {robot_of("giraff", one.token) for one in (old, new)} == {robot}
    assert set(at_the_broker()) == {"giraff", new.user}
    later = timezone.now() + GRACE
    assert list(users_of("giraff", robot.credentials, later)) == [new.user]


def test_both_users_at_the_broker_have_the_permissions_of_the_robot(robot):
    _, new = rotated(robot)
    old_user, new_user = sorted(robots_at_the_broker(), key=lambda user: len(user.name))
    assert (old_user.name, new_user.name) == ("giraff", new.user)
    assert old_user.permissions == new_user.permissions
    assert not may_publish(new_user.permissions, "telepresence/v1/rhodon/state")


def test_old_user_at_the_broker_expires(robot, monkeypatch):
    _, new = rotated(robot)
    assert set(at_the_broker()) == {"giraff", new.user}
    later = timezone.now() + GRACE
    monkeypatch.setattr("robots.broker.users.timezone.now", lambda: later)
    assert set(at_the_broker()) == {new.user}


def test_unchanged_robot_keeps_its_user_object(robot):
    make_credentials(robot, timezone.now())
    other = Robot.objects.create(name="rhodon", title="Rhodon")
    make_credentials(other, timezone.now())
    giraff, rhodon = robots_at_the_broker()
    make_credentials(other, timezone.now())
    same, changed = robots_at_the_broker()
    assert same is giraff
    assert changed.credential_hash != rhodon.credential_hash


def test_agent_that_lost_the_answer_renews_again_with_its_old_credentials(robot):
    old, lost = rotated(robot)
    again = rotate(robot, old.token, timezone.now())
    assert robot_of("giraff", lost.token) is None
    assert {robot_of("giraff", one.token) for one in (old, again)} == {robot}


def test_former_credentials_cannot_be_extended(robot):
    now = timezone.now()
    old = make_credentials(robot, now)
    rotate(robot, old.token, now)
    rotate(robot, old.token, now + GRACE / 2)
    assert robot.credentials.former_until == now + GRACE


def test_revoking_ends_old_and_new_credentials(robot):
    old, new = rotated(robot)
    revoke(robot)
    assert at_the_broker() == {}
    assert (robot_of("giraff", old.token), robot_of("giraff", new.token)) == (None, None)


def test_credentials_made_by_hand_end_all_earlier_ones(robot):
    old, new = rotated(robot)
    newest = make_credentials(robot, timezone.now())
    assert list(at_the_broker()) == [newest.user]
    assert [robot_of("giraff", one.token) for one in (old, new, newest)] == [None, None, robot]


def test_new_credentials_never_reuse_a_user_of_the_broker(robot):
    """Mosquitto disconnects clients whose user was deleted, not those with an old password."""
    users = [make_credentials(robot, timezone.now()).user or "giraff"]
    revoke(robot)
    users += [make_credentials(robot, timezone.now()).user for _ in range(2)]
    assert len(set(users)) == 3


def post(client, address, content, token=""):
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    return client.post(
        address, json.dumps(content), content_type="application/json", headers=headers
    )


def test_token_is_accepted_only_by_post(client, robot):
    token = make_token(robot, timezone.now())
    assert client.get(ENROL, {"robot": "giraff", "token": token}).status_code == 405
    assert post(client, ENROL, {"robot": "giraff", "token": "guess"}).status_code == 403
    assert post(client, ENROL, ["nonsense"]).status_code == 400
    assert client.post(ENROL, "[" * 4000, content_type="application/json").status_code == 400
    answer = post(client, ENROL, {"robot": "giraff", "token": token})
    assert answer.status_code == 200
    assert "no-store" in answer["Cache-Control"]
    assert robot_of("giraff", answer.json()["token"]) == robot
    assert AuditEntry.objects.get(act="robot_enrolled").robot == "giraff"


def test_credentials_are_renewed_only_on_request(client, robot):
    old = make_credentials(robot, timezone.now())
    assert post(client, RENEW, {}, "giraff:guess").status_code == 401
    assert post(client, RENEW, {}, f"giraff:{old.token}").json() == {"robot": "giraff"}
    ask_for_renewal(robot, timezone.now())
    fresh = post(client, RENEW, {}, f"giraff:{old.token}").json()
    assert robot_of("giraff", fresh["token"]) == robot
    assert post(client, RENEW, {}, f"giraff:{fresh['token']}").json() == {"robot": "giraff"}


@pytest.fixture
def server(client, monkeypatch):
    """The site as reached by the agent."""

    def answer(url, headers, _ca, _reasons, content):
        found = client.post(
            url.removeprefix("https://site.example"),
            json.dumps(content),
            content_type="application/json",
            headers=headers,
        )
        if found.status_code >= 400:
            raise ConfigError(f"the server refused the request: {found.json()['detail']}")
        return found.json()

    monkeypatch.setattr(agent_side, "request_json", answer)
    return "https://site.example"


@pytest.fixture
def given(robot, server, tmp_path):
    """The arguments of an agent that enrols."""
    token = make_token(robot, timezone.now())
    own = {"robot": "giraff", "server": server, "adapter": "moos", "var": tmp_path}
    return own | {"enrol": token}


def test_agent_enrols_and_then_starts_without_the_token(robot, server, given, tmp_path):
    agent_of(given)
    file = tmp_path / "credentials" / "giraff.toml"
    if sys.platform != "win32":
        assert stat.S_IMODE(file.stat().st_mode) == 0o600
    config = load({"robot": "giraff", "adapter": "moos", "var": tmp_path}, {})
    assert (config.server, config.user, config.credentials) == (server, "giraff", file)
    assert robot_of("giraff", config.token) == robot
    with pytest.raises(ConfigError, match="was used"):
        agent_of(given)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"adapter": None}, "no adapter is given"),
        ({"adapter": "ADAPTER"}, "no adapter 'ADAPTER'"),
        ({"profile": "PROFILE"}, "no robot profile 'PROFILE'"),
        ({"option": ["hots=10.0.0.1"]}, "no option hots"),
        ({"plan": "nowhere"}, "nowhere"),
        ({"loudspeaker": "talk.mp4"}, "is not a loudspeaker"),
        ({"viewers": "all"}, "--viewers"),
    ],
)
def test_token_is_used_only_by_an_agent_with_valid_arguments(given, wrong, sentence):
    with pytest.raises(ConfigError, match=sentence):
        agent_of(given | {"profile": "giraff"} | wrong)
    assert redeem("giraff", given["enrol"], timezone.now()) is not None


@pytest.mark.parametrize("broken", ["file is a folder", "folder is a file"])
def test_token_is_not_used_for_credentials_that_cannot_be_saved(broken, tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(agent_side, "request_json", lambda *_: asked.append(1))
    path = tmp_path / "here" / "giraff.toml"
    if broken == "file is a folder":
        path.mkdir(parents=True)
    else:
        path.parent.write_text("")
    with pytest.raises(ConfigError, match="cannot be saved in"):
        agent_side.enrol("giraff", "https://site.example", "token", path)
    assert not asked
    assert not list(tmp_path.rglob("*.new"))


def test_enrolment_uses_the_certificates_named_in_the_environment(tmp_path, monkeypatch):
    asked = []
    answer = {"robot": "giraff", "token": "t"}
    monkeypatch.setattr(agent_side, "request_json", lambda *sent: asked.append(sent[2]) or answer)
    given = {"CA": "/ca.pem", "ADAPTER": "moos", "ENROL": "token"}
    environment = {f"TELEPRESENCE_{name}": value for name, value in given.items()}
    arguments = {"robot": "giraff", "server": "https://site.example", "var": tmp_path}
    agent_side.enrol_if_asked(arguments, environment)
    assert asked == ["/ca.pem"]


@pytest.mark.parametrize("given", ["command line", "environment", "nothing"])
def test_run_robot_stores_files_in_the_given_folder_or_in_var_dir(
    given, settings, tmp_path, monkeypatch
):
    settings.VAR_DIR, folder = tmp_path / "site", tmp_path / "folder"
    # the command sets the robot for all log lines of the process, here that of all tests
    monkeypatch.setattr(log_ids, "_process", {})
    kept = []
    monkeypatch.setattr(run_robot, "agent_of", lambda given: kept.append(Path(given["var"])))
    monkeypatch.setattr(run_robot, "run_until_signalled", lambda _agent: None)
    if given == "environment":
        monkeypatch.setenv("TELEPRESENCE_VAR", str(folder))
    call_command("run_robot", "giraff", **({"var": folder} if given == "command line" else {}))
    assert kept == [settings.VAR_DIR if given == "nothing" else folder]


def test_agent_changes_only_the_credentials_in_its_file(robot, server, tmp_path):
    file = tmp_path / "giraff.toml"
    content = make_credentials(robot, timezone.now()).toml(server=server)
    file.write_text(content + '# mine\n[options]\nuser = "camera"\n')
    given = {"robot": "giraff", "credentials": file, "adapter": "moos", "var": tmp_path}
    config = load(given, {})
    assert agent_side.renew(config) is None
    ask_for_renewal(robot, timezone.now())
    fresh = agent_side.renew(config)
    again = load(given, {})
    assert (again.token, again.user, again.server) == (fresh["token"], fresh["user"], server)
    assert again.options == {"user": "camera"}
    assert "# mine" in file.read_text()
    assert tomllib.loads(file.read_text())["robot"] == "giraff"
    assert set(at_the_broker()) == {"giraff", again.user}


def test_agent_with_a_read_only_file_does_not_renew(robot, server, tmp_path, monkeypatch):
    file = tmp_path / "giraff.toml"
    file.write_text(make_credentials(robot, timezone.now()).toml(server=server))
    config = load({"robot": "giraff", "credentials": file, "adapter": "moos", "var": tmp_path}, {})
    ask_for_renewal(robot, timezone.now())
    monkeypatch.setattr(agent_side.os, "access", lambda *_: False)
    assert agent_side.renew(config) is None
    assert robot_of("giraff", config.token).credentials.renewal_asked_at is not None


def test_agent_repeats_its_request_until_it_has_new_credentials(robot, tmp_path, monkeypatch):
    config = load(
        {"robot": "giraff", "server": "https://site.example", "adapter": "moos", "var": tmp_path},
        {"TELEPRESENCE_TOKEN": "t"},
    )
    fresh = {"robot": "giraff", "user": "giraff.1", "token": "new"}
    answers = [ServerAwayError("no network"), ConfigError("disk full"), None, fresh]
    renewed, pauses = [], []

    def renew(_config):
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def pause(seconds):
        pauses.append(seconds)
        return False

    monkeypatch.setattr(agent_side, "renew", renew)
    agent_side.keep_renewing(config, renewed.append, pause)
    assert renewed == [fresh]
    assert len(pauses) == 4
    agent_side.keep_renewing(config, renewed.append, lambda _seconds: True)
    assert len(renewed) == 1


@pytest.mark.parametrize(
    "server",
    [f"http://{name}" for name in ("robots.example", "localhost.evil.example", "10.0.0.1:8000")]
    + ["ftp://robots.example"],
)
def test_token_is_not_sent_without_tls(server, tmp_path):
    with pytest.raises(ConfigError, match="https"):
        agent_side.enrol("giraff", server, "token", tmp_path / "giraff.toml")


@pytest.mark.parametrize(
    "server",
    ["https://robots.example"]
    + [f"http://{name}:8000" for name in ("127.0.0.1", "localhost", "[::1]")],
)
def test_tls_and_plain_http_on_this_machine_are_accepted(server):
    agent_side.check_private(server)


def test_token_without_a_server_is_refused(tmp_path):
    arguments = {"robot": "giraff", "var": tmp_path}
    with pytest.raises(ConfigError, match="--server"):
        agent_side.enrol_if_asked(arguments, {"TELEPRESENCE_ENROL": "token"})


def test_enrol_command_prints_what_to_run_on_the_robot(robot):
    out = io.StringIO()
    call_command("enrol", "giraff", server="https://site.example/", stdout=out)
    command, _, token = out.getvalue().splitlines()[-1].rpartition(" ")
    assert (
        command == "telepresence run_robot giraff --server https://site.example"
        " --adapter ADAPTER --profile PROFILE --enrol"
    )
    assert redeem("giraff", token, timezone.now()) is not None
    server = ["--server", "https://site.example"]
    for wrong, sentence in (
        (["unknown", *server], "unknown"),
        (["giraff", *server, "--hours", "0"], "--hours"),
        (["giraff"], "--server"),
    ):
        with pytest.raises(CommandError, match=sentence):
            call_command("enrol", *wrong)


def test_rotate_command_requests_new_credentials_of_robots_that_have_some(robot):
    make_credentials(robot, timezone.now())
    Robot.objects.create(name="rhodon", title="Rhodon")
    out = io.StringIO()
    call_command("rotate_credentials", stdout=out)
    assert out.getvalue().split() == ["giraff"]
    assert Robot.objects.get(name="giraff").credentials.renewal_asked_at is not None
    with pytest.raises(CommandError, match="rhodon"):
        call_command("rotate_credentials", "rhodon")


def test_one_of_two_concurrent_renewals_is_refused(client, robot, monkeypatch):
    shown = make_credentials(robot, timezone.now())
    bearer = {"Authorization": f"Bearer giraff:{shown.token}"}
    ask_for_renewal(robot, timezone.now())
    new_user, answers = credentials._new_user, []

    def renewing_first(robot):
        monkeypatch.setattr(credentials, "_new_user", new_user)
        answers.append(client.post(RENEW, headers=bearer))
        return new_user(robot)

    monkeypatch.setattr(credentials, "_new_user", renewing_first)
    answers.append(client.post(RENEW, headers=bearer))
    assert [answer.status_code for answer in answers] == [200, 409]
    taken = answers[0].json()
    assert robot_of("giraff", taken["token"]) == robot
    assert set(at_the_broker()) == {"giraff", taken["user"]}
