"""`manage.py mosquitto_files`, for a broker that is not a child of ours."""

import asyncio
import contextlib
import getpass
import io
import subprocess

import pytest
from asgiref.sync import sync_to_async
from django.core.management import CommandError, call_command
from django.utils import timezone

from robots.api.topics import of
from robots.broker.engines import ENGINES
from robots.enrol.credentials import make_credentials, revoke, server_credentials
from robots.management.commands.mosquitto_files import Files
from robots.models import Robot
from tests.support.sessions.broker_rig import SECONDS, PasswordClients, until_thrown_out
from tests.support.sessions.site import free_port, wait_for

pytestmark = [pytest.mark.broker, pytest.mark.django_db(transaction=True)]


def write(directory, *arguments, pid_file=None):
    if pid_file is not None:
        arguments = (*arguments, "--reload", "--pid-file", str(pid_file))
    out = io.StringIO()
    call_command("mosquitto_files", str(directory), *arguments, stdout=out)
    return out.getvalue()


class Server(PasswordClients):
    """A mosquitto with a configuration, a port and a pid file of its own."""

    def __init__(self, directory):
        self.port, self.pid_file = free_port(), directory / "mosquitto.pid"
        (directory / "mosquitto.conf").write_text(
            f"listener {self.port} 127.0.0.1\nallow_anonymous false\npassword_file"
            f" {directory / 'passwords'}\nacl_file {directory / 'permissions'}\npid_file"
            f" {self.pid_file}\npersistence false\nuser {getpass.getuser()}\n"
        )
        self.process = subprocess.Popen(
            [ENGINES["mosquitto"].find(), "-c", str(directory / "mosquitto.conf")],
            stderr=subprocess.DEVNULL,
        )
        written = lambda: self.pid_file.exists() and self.pid_file.read_text().strip()
        wait_for(lambda: self.process.poll() is None and written(), 10, "mosquitto's pid file")


@pytest.fixture
def mosquitto(tmp_path, db):
    write(tmp_path)
    server = Server(tmp_path)
    yield server
    server.process.terminate()
    server.process.wait(SECONDS)


async def test_a_mosquitto_of_the_system_follows_the_database(mosquitto, tmp_path):
    again = sync_to_async(lambda: write(tmp_path, pid_file=mosquitto.pid_file))
    await mosquitto.until_let_in(*server_credentials("web"))
    robot = await Robot.objects.acreate(name="giraff", title="Giraff")
    key = await sync_to_async(make_credentials)(robot, timezone.now())
    assert not await mosquitto.lets_in("giraff", key.token)
    assert "3 users written" in await again()
    await mosquitto.until_let_in("giraff", key.token)
    async with mosquitto.client("giraff", key.token) as giraff:
        await giraff.publish(of("giraff", "state"), b"{}", qos=1)
        await sync_to_async(revoke)(robot)
        assert "2 users written" in await again()
        await until_thrown_out(giraff)  # at once, not when it reconnects
    assert not await mosquitto.lets_in("giraff", key.token)
    assert await mosquitto.lets_in(*server_credentials("web"))


async def test_with_watch_it_writes_changes_and_signals_mosquitto(mosquitto, tmp_path):
    watching = asyncio.create_task(Files(tmp_path, mosquitto.pid_file).follow(0.05))
    robot = await Robot.objects.acreate(name="giraff", title="Giraff")
    key = await sync_to_async(make_credentials)(robot, timezone.now())
    await mosquitto.until_let_in("giraff", key.token)
    watching.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await watching


def test_unchanged_files_are_not_written_again(tmp_path):
    assert "2 users written" in write(tmp_path)
    before = {name: (tmp_path / name).stat().st_mtime_ns for name in ("passwords", "permissions")}
    assert "users unchanged" in write(tmp_path)
    assert before == {name: (tmp_path / name).stat().st_mtime_ns for name in before}


def test_nats_has_the_same_users_in_one_file(tmp_path):
    robot = Robot.objects.create(name="giraff", title="Giraff")
    token = make_credentials(robot, timezone.now()).token
    assert "3 users written" in write(tmp_path, "--engine", "nats")
    text = (tmp_path / "users.conf").read_text()
    names = ("giraff", "server.web", "server.session-manager")
    assert all(f'"user": "{name}"' in text for name in names)
    assert token not in text
    assert "users unchanged" in write(tmp_path, "--engine", "nats")
    assert [path.name for path in tmp_path.iterdir()] == ["users.conf"]


def test_only_owner_and_group_can_read_the_files(tmp_path):
    write(tmp_path)
    assert {path.stat().st_mode & 0o777 for path in tmp_path.iterdir()} <= {0o640, 0o600}
    token = server_credentials("web")[1]
    assert all(token not in path.read_text() for path in tmp_path.iterdir())


def test_the_files_are_written_also_while_mosquitto_does_not_run(tmp_path):
    assert "2 users written" in write(tmp_path, pid_file=tmp_path / "nobody.pid")
    # greater than any process id, because the id of an ended process may be another's by now
    (tmp_path / "dead.pid").write_text("99999999")
    (tmp_path / "permissions").unlink()
    assert "2 users written" in write(tmp_path, pid_file=tmp_path / "dead.pid")


def test_an_error_is_one_sentence(tmp_path):
    with pytest.raises(CommandError, match=r"No such file or directory\.$"):
        write(tmp_path / "nowhere")
    (tmp_path / "bad.pid").write_text("not a number")
    with pytest.raises(CommandError, match="could not be signalled"):
        write(tmp_path, pid_file=tmp_path / "bad.pid")
