"""All log lines while users and robots log in, at the most verbose level, contain no secret."""

import json
import logging
import re

import aiomqtt
import pytest
from asgiref.sync import sync_to_async
from channels.testing import HttpCommunicator
from django.core import mail
from django.test import Client
from django.utils import timezone

from robots.bridge import bridge as mqtt_bridge
from robots.enrol.credentials import make_credentials, server_credentials
from robots.ice import turn_credentials
from robots.models import Robot
from sessions import protocol
from telepresence_site.asgi import application  # configures logging, before the LogCollector
from telepresence_site.ops.log_lines import json_lines
from telepresence_site.settings import LOGGING
from tests.support import words
from tests.support.browsers.pages import Page
from tests.support.patience import patient
from tests.support.people import PASSWORD, person
from tests.support.robots import create_robot
from tests.support.sessions.broker_rig import BrokerRig
from tests.support.sessions.memory_bridge import MemoryBridge

pytestmark = [pytest.mark.broker, pytest.mark.django_db(transaction=True)]
TURN_SECRET = "what-coturn-and-the-site-share"
METRICS_TOKEN = "what-prometheus-and-the-site-share"
WRONG = "a-password-that-is-wrong-1"


class LogCollector(logging.Handler):
    """Keeps log lines as other handlers write them, and as ours do."""

    def __init__(self):
        super().__init__(logging.DEBUG)
        self.raw, self.lines = [], []

    def emit(self, record):
        self.lines.append(json_lines().format(record))
        # has the path, which may be a one-time link: our lines have the route
        if record.name != "django.request":
            self.raw.append(logging.Formatter("%(name)s %(message)s").format(record))


@pytest.fixture
def collector(settings):
    settings.TURN_SECRET, settings.METRICS_TOKEN = TURN_SECRET, METRICS_TOKEN
    settings.TURN_URLS = ["turn:turn.example.org"]
    collector, root = LogCollector(), logging.getLogger()
    level = root.level
    root.addHandler(collector)
    root.setLevel(logging.DEBUG)
    yield collector
    root.removeHandler(collector)
    root.setLevel(level)


def visit_the_site():
    client = Client()
    client.post("/accounts/signup/", {"username": "eve", "password1": PASSWORD, "email": ""})
    client.post("/accounts/login/", {"login": "ada", "password": WRONG})
    client.post("/accounts/login/", {"login": "ada", "password": PASSWORD})
    client.post("/accounts/password/reset/", {"email": "ada@example.org"})
    key = re.search(r"/accounts/password/reset/key/([^/\s]+)/", mail.outbox[-1].body)[1]
    return key, [cookie.value for cookie in client.cookies.values() if len(cookie.value) > 8]


async def ask(path, cookies=(), **headers):
    """Request a page of the whole application, as daphne does; return the status."""
    cookie = "; ".join(f"sessionid={cookie}" for cookie in cookies)
    headers = {"host": "127.0.0.1", "cookie": cookie, **headers}
    pairs = [(name.encode(), value.encode()) for name, value in headers.items()]
    page = HttpCommunicator(application, "GET", path, headers=pairs)
    return (await page.get_response(timeout=patient(5.0)))["status"]


async def drive(ada):
    async with Page("giraff", ada) as page:
        await page.say("session/take", protocol.Take())
        granted = await page.expect("session/granted")
        own = {"session": granted.session, "epoch": granted.epoch}
        await page.say("command/velocity", words.velocity(**own))
    return [server.credential for server in granted.ice_servers if server.credential]


async def knock(tmp_path, kind):
    """Connect a robot to a broker with the right and with a wrong key."""
    rig = BrokerRig(kind, tmp_path / "broker")
    await rig.start()
    token = rig.tokens[await rig.robot("giraff")]
    async with rig.client("giraff"):
        pass
    with pytest.raises(aiomqtt.MqttError):
        async with rig.client("giraff", token=WRONG):
            pass
    await rig.stop()
    return token


async def test_no_password_token_credential_or_cookie_is_ever_logged(collector, settings, tmp_path):
    bridge = MemoryBridge()
    mqtt_bridge.use(bridge)
    try:
        ada = await sync_to_async(person)("ada", email="ada@example.org")
        robot = await sync_to_async(create_robot)(
            name="giraff", title="Giraff", connection="ONLINE", last_seen_at=timezone.now()
        )
        key = await sync_to_async(make_credentials)(robot, timezone.now())
        reset, cookies = await sync_to_async(visit_the_site)()
        secrets = [reset, *cookies]
        await ask(f"/accounts/password/reset/key/{reset}/", cookies)
        assert await ask(f"/accounts/password/reset/lost/{reset}/", cookies) == 404
        assert await ask("/api/v1/agent/", authorization=f"Bearer giraff:{WRONG}") == 401
        assert await ask("/api/v1/agent/", authorization=f"Bearer giraff:{key.token}") == 200
        assert await ask("/metrics", authorization=f"Bearer {METRICS_TOKEN}") == 200
        secrets += await drive(ada)
        secrets.append(await knock(tmp_path, "nats"))
    finally:
        mqtt_bridge.use(None)
    hashes = [await sync_to_async(lambda: Robot.objects.get().credentials.credential_hash)()]
    passwords = [PASSWORD, WRONG, key.token, TURN_SECRET, METRICS_TOKEN, settings.SECRET_KEY]
    passwords.append(server_credentials("web")[1])
    assert len(secrets) >= 4
    for lines in (collector.raw, collector.lines):
        assert len(lines) >= 8
        found = [
            (secret, line)
            for secret in (*passwords, *secrets, *hashes)
            for line in lines
            if secret in line or json.dumps(secret)[1:-1] in line
        ]
        assert found == []


def test_log_collector_finds_a_secret(collector):
    logging.getLogger("some.library").debug("connecting with %s", PASSWORD)
    assert any(PASSWORD in line for line in collector.lines)
    assert turn_credentials("ada", TURN_SECRET, 0.0)[1] != TURN_SECRET


def test_every_handler_of_the_site_uses_our_formatter():
    used = {handler["formatter"] for handler in LOGGING["handlers"].values()}
    made = {LOGGING["formatters"][name]["()"].rpartition(".")[2] for name in used}
    assert made <= {"json_lines", "key_value_lines"}
