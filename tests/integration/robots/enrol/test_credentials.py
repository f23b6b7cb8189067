"""Tokens, their hashes in Mosquitto's form, and who remembers what."""

import datetime
import subprocess
import tomllib
from argparse import ArgumentParser

import bcrypt
import pytest
from asgiref.sync import sync_to_async

from robots.agent.config import add_arguments
from robots.api.topics import ROBOT_NAME
from robots.broker.engines import ENGINES
from robots.broker.users import read_users
from robots.enrol import credentials
from robots.enrol.credentials import (
    Credentials,
    hash_token,
    matches,
    new_token,
    server_client_id,
    server_credentials,
)
from robots.models import Robot, RobotCredentials
from tests.support.robots import create_robot

NOW = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)


def test_a_token_matches_its_hash_and_no_other():
    token = new_token()
    assert len(token) >= 43  # 256 bits in base64
    assert matches(token, hash_token(token))
    assert not matches(new_token(), hash_token(token))
    assert hash_token(token) != hash_token(token)


def test_no_token_is_taken_for_an_option_of_the_command_that_it_stands_behind(monkeypatch):
    drawn = ["-begins-with-a-dash", "--with-two", "and-not"]
    monkeypatch.setattr(credentials.secrets, "token_urlsafe", lambda _bytes: drawn.pop(0))
    parser = ArgumentParser()
    add_arguments(parser)
    assert parser.parse_args(["giraff", "--enrol", new_token()]).enrol == "and-not"


def test_the_hash_is_the_one_that_mosquitto_makes(tmp_path):
    # the Debian package of mosquitto has mosquitto_passwd
    assert ENGINES["mosquitto"].find() is not None
    path = tmp_path / "passwords"
    path.write_text("giraff:a token\n")
    subprocess.run(["mosquitto_passwd", "-U", str(path)], check=True, capture_output=True)
    made = path.read_text().strip().removeprefix("giraff:")
    assert made.startswith("$7$")
    assert matches("a token", made)
    assert not matches("another", made)


@pytest.mark.parametrize(
    "broken",
    [
        "",
        "$7$",
        "$7$x$AA==$AA==",
        "$6$101$AA==$AA==",
        "$7$0$AA==$AA==",
        "$7$101$!$!",
        "$7$999999999$AA==$AA==",
        "plain",
    ],
)
def test_a_malformed_hash_matches_nothing(broken):
    assert not matches("", broken)
    assert not matches("token", broken)


@pytest.mark.django_db
def test_making_credentials_replaces_the_old_ones_and_revoking_ends_them():
    robot = Robot.objects.create(name="giraff", title="Giraff")
    first = credentials.make_credentials(robot, NOW)
    second = credentials.make_credentials(robot, NOW)
    assert credentials.robot_of("giraff", first.token) is None
    assert credentials.robot_of("giraff", second.token) == robot
    credentials.revoke(robot)
    assert credentials.robot_of("giraff", second.token) is None
    assert credentials.robot_of("giraff", "") is None


@pytest.mark.django_db
def test_every_token_has_a_bcrypt_hash_which_is_deleted_with_it():
    robot = Robot.objects.create(name="giraff", title="Giraff")
    first = credentials.make_credentials(robot, NOW)
    assert bcrypt_hash_fits(first.token, robot.credentials.bcrypt_hash)
    second = credentials.rotate(robot, first.token, NOW)
    assert bcrypt_hash_fits(second.token, robot.credentials.bcrypt_hash)
    assert bcrypt_hash_fits(first.token, robot.credentials.former_bcrypt_hash)
    credentials.revoke(robot)
    robot.refresh_from_db()
    assert robot.credentials.bcrypt_hash == robot.credentials.former_bcrypt_hash == ""


@pytest.mark.django_db
def test_a_token_without_a_bcrypt_hash_gets_one_when_an_agent_sends_it():
    robot = Robot.objects.create(name="giraff", title="Giraff")
    token = credentials.make_credentials(robot, NOW).token
    RobotCredentials.objects.update(bcrypt_hash="")
    assert credentials.robot_of("giraff", "wrong") is None
    assert Robot.objects.get().credentials.bcrypt_hash == ""
    assert credentials.robot_of("giraff", token) == robot
    assert bcrypt_hash_fits(token, Robot.objects.get().credentials.bcrypt_hash)


def bcrypt_hash_fits(token, made):
    return bcrypt.checkpw(token.encode(), made.encode())


@pytest.mark.django_db
def test_a_disabled_robots_token_is_worthless():
    robot = Robot.objects.create(name="giraff", title="Giraff")
    token = credentials.make_credentials(robot, NOW).token
    Robot.objects.update(enabled=False)
    assert credentials.robot_of("giraff", token) is None


@pytest.mark.django_db
def test_the_token_itself_is_nowhere_in_the_database():
    robot = Robot.objects.create(name="giraff", title="Giraff")
    token = credentials.make_credentials(robot, NOW).token
    assert token not in str(Robot.objects.values().get())


def test_the_token_does_not_show_in_a_log():
    assert "secret" not in repr(Credentials("giraff", "secret"))


def test_the_credentials_file_is_toml_for_its_owner_alone(tmp_path):
    path = tmp_path / "keys" / "giraff.toml"
    path.parent.mkdir()
    path.write_text("old")
    path.chmod(0o644)
    credentials.keep_credentials(
        Credentials("giraff", 'a"b\\c'), path, server="https://example.org"
    )
    assert tomllib.loads(path.read_text()) == {
        "robot": "giraff",
        "token": 'a"b\\c',
        "server": "https://example.org",
    }
    assert path.stat().st_mode & 0o777 == 0o600


def test_no_robot_can_be_called_like_a_server_process():
    for part in credentials.SERVER_USERS:
        user, password = server_credentials(part)
        assert not ROBOT_NAME.match(user)
        assert len(password) == 64
    assert server_credentials("web") == server_credentials("web")
    assert server_credentials("web")[1] != server_credentials("session-manager")[1]


def test_a_client_id_that_lasts_cannot_be_guessed(settings):
    before = server_client_id("session-manager")
    assert before == server_client_id("session-manager")
    settings.SECRET_KEY = "another"
    assert server_client_id("session-manager") != before


@pytest.mark.django_db(transaction=True)
async def test_the_brokers_users_are_servers_and_enabled_robots_with_credentials():
    hashes = {"giraff": hash_token("a"), "disabled": hash_token("b"), "keyless": ""}
    for name, credential_hash in hashes.items():
        await sync_to_async(create_robot)(
            name=name, title=name, enabled=name != "disabled", credential_hash=credential_hash
        )
    users = await read_users()
    assert set(users) == {"giraff", "server.web", "server.session-manager"}
    assert matches(server_credentials("web")[1], users["server.web"].credential_hash)
    assert users == await read_users()  # equal, so that no file is written again
