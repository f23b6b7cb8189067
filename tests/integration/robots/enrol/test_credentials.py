"""Tokens, their hashes in Mosquitto's and bcrypt's format, and the cache of verified ones."""

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


@pytest.fixture
def robot(db):
    return Robot.objects.create(name="giraff", title="Giraff")


def test_token_matches_only_its_own_hash():
    token = new_token()
    assert len(token) >= 43  # 256 bits in base64
    assert matches(token, hash_token(token))
    assert not matches(new_token(), hash_token(token))
    assert hash_token(token) != hash_token(token)


def test_token_does_not_begin_with_a_dash(monkeypatch):
    drawn = ["-begins-with-a-dash", "--with-two", "and-not"]
    monkeypatch.setattr(credentials.secrets, "token_urlsafe", lambda _bytes: drawn.pop(0))
    parser = ArgumentParser()
    add_arguments(parser)
    assert parser.parse_args(["giraff", "--enrol", new_token()]).enrol == "and-not"


def test_hash_of_mosquitto_passwd_matches(tmp_path):
    # The Debian package of mosquitto contains mosquitto_passwd.
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
        *("", "$7$", "plain", "$7$101$!$!", "$7$x$AA==$AA==", "$6$101$AA==$AA=="),
        *("$7$0$AA==$AA==", "$7$999999999$AA==$AA=="),
    ],
)
def test_malformed_hash_matches_no_token(broken):
    assert not matches("", broken)
    assert not matches("token", broken)


def test_every_token_has_a_bcrypt_hash_that_is_revoked_with_it(robot):
    first = credentials.make_credentials(robot, NOW)
    assert bcrypt_hash_fits(first.token, robot.credentials.bcrypt_hash)
    second = credentials.rotate(robot, first.token, NOW)
    assert bcrypt_hash_fits(second.token, robot.credentials.bcrypt_hash)
    assert bcrypt_hash_fits(first.token, robot.credentials.former_bcrypt_hash)
    credentials.revoke(robot)
    robot.refresh_from_db()
    assert robot.credentials.bcrypt_hash == robot.credentials.former_bcrypt_hash == ""


def test_older_token_gets_a_bcrypt_hash_when_an_agent_uses_it(robot):
    token = credentials.make_credentials(robot, NOW).token
    RobotCredentials.objects.update(bcrypt_hash="")
    assert credentials.robot_of("giraff", "wrong") is None
    assert Robot.objects.get().credentials.bcrypt_hash == ""
    assert credentials.robot_of("giraff", token) == robot
    assert bcrypt_hash_fits(token, Robot.objects.get().credentials.bcrypt_hash)


def bcrypt_hash_fits(token, made):
    return bcrypt.checkpw(token.encode(), made.encode())


def test_token_is_not_in_the_database(robot):
    token = credentials.make_credentials(robot, NOW).token
    assert token not in str(Robot.objects.values().get())


def test_token_is_not_in_the_representation_of_credentials():
    assert "secret" not in repr(Credentials("giraff", "secret"))


def test_credentials_file_is_toml_that_only_its_owner_can_read(tmp_path):
    path = tmp_path / "keys" / "giraff.toml"
    path.parent.mkdir()
    path.write_text("old")
    path.chmod(0o644)
    made = Credentials("giraff", 'a"b\\c')
    credentials.keep_credentials(made, path, server="https://example.org")
    stored = {"robot": "giraff", "token": 'a"b\\c', "server": "https://example.org"}
    assert tomllib.loads(path.read_text()) == stored
    assert path.stat().st_mode & 0o777 == 0o600


def test_server_users_are_no_valid_robot_names():
    for part in credentials.SERVER_USERS:
        user, password = server_credentials(part)
        assert not ROBOT_NAME.match(user)
        assert len(password) == 64
    assert server_credentials("web") == server_credentials("web")
    assert server_credentials("web")[1] != server_credentials("session-manager")[1]


def test_client_id_of_the_server_depends_on_the_secret_key(settings):
    before = server_client_id("session-manager")
    assert before == server_client_id("session-manager")
    settings.SECRET_KEY = "another"
    assert server_client_id("session-manager") != before


@pytest.mark.django_db(transaction=True)
async def test_brokers_users_are_servers_and_enabled_robots_with_credentials():
    hashes = {"giraff": hash_token("a"), "disabled": hash_token("b"), "keyless": ""}
    for name, credential_hash in hashes.items():
        await sync_to_async(create_robot)(
            name=name, title=name, enabled=name != "disabled", credential_hash=credential_hash
        )
    users = await read_users()
    assert set(users) == {"giraff", "server.web", "server.session-manager"}
    assert matches(server_credentials("web")[1], users["server.web"].credential_hash)
    assert users == await read_users()  # equal, so that no file is written again
