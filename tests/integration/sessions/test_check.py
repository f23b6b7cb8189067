"""The page that checks browser and network, and its echoing WebSocket."""

import json
import re

import pytest
from channels.testing import WebsocketCommunicator
from django.contrib.auth.models import AnonymousUser

from accounts.models import User
from robots.models import Robot, RobotPermit
from sessions import protocol
from sessions.consumers.connection_check import MAX_ECHOES, MAX_LENGTH, CheckConsumer
from telepresence_site import asgi
from tests.support.browsers.pages import ORIGIN
from tests.support.patience import patient

# a consumer closes all database connections of its thread, as well as those of the test
pytestmark = pytest.mark.django_db


def servers_on(page) -> list[dict]:
    config = re.search(r'id="config"[^>]*>(.*?)</script>', page.content.decode())[1]
    return json.loads(config)["iceServers"]


def test_relays_are_only_for_visitors_who_have_a_robot(client, settings):
    settings.STUN_URLS, settings.TURN_URLS = ["stun:a.example"], ["turn:a.example"]
    settings.TURN_SECRET = "secret"
    assert servers_on(client.get("/check/")) == [{"urls": ["stun:a.example"]}]
    client.force_login(User.objects.create_user("ada", password="x"))
    giraff = Robot.objects.create(name="giraff", title="Giraff", access=Robot.Access.INVITATION)
    assert servers_on(client.get("/check/")) == [{"urls": ["stun:a.example"]}]
    invited = RobotPermit.Privilege.INVITED
    RobotPermit.objects.create(robot=giraff, user=User.objects.get(), kind=invited)
    signed_in = servers_on(client.get("/check/"))
    assert [server["urls"] for server in signed_in] == [["stun:a.example"], ["turn:a.example"]]
    assert signed_in[1]["username"].endswith(str(User.objects.get().pk))


@pytest.mark.parametrize(
    ("language", "title"), [("en", "Check my connection"), ("es", "Comprobar mi conexión")]
)
def test_page_is_in_the_visitors_language(client, settings, language, title):
    settings.STUN_URLS = []
    page = client.get("/check/", headers={"Accept-Language": language})
    assert title in page.content.decode()
    assert servers_on(page) == []


async def opened() -> WebsocketCommunicator:
    line = WebsocketCommunicator(CheckConsumer.as_asgi(), f"/{protocol.CHECK_PATH}")
    line.scope["user"] = AnonymousUser()
    connected, _ = await line.connect(timeout=patient(5))
    assert connected
    return line


async def test_socket_echoes_a_few_short_messages():
    line = await opened()
    for _ in range(MAX_ECHOES):
        await line.send_to("?")
        assert await line.receive_from(timeout=patient(5)) == "?"
    await line.send_to("?")
    closed = {"type": "websocket.close", "code": protocol.FLOODED}
    assert await line.receive_output(timeout=patient(5)) == closed
    await line.disconnect()


async def test_open_sockets_are_limited_per_address(monkeypatch):
    monkeypatch.setattr(asgi.counted, "_limit", 2)
    lines = []
    for address in ("198.51.100.7", "198.51.100.7", "198.51.100.7", "198.51.100.8"):
        line = WebsocketCommunicator(
            asgi.application,
            f"/{protocol.CHECK_PATH}",
            headers=[(b"host", b"127.0.0.1"), (b"origin", ORIGIN.encode())],
        )
        line.scope["client"] = (address, 1)
        lines.append((line, (await line.connect(timeout=patient(5)))[0]))
    assert [connected for _, connected in lines] == [True, True, False, True]
    for line, connected in lines:
        if connected:
            await line.disconnect()


async def test_long_message_closes_the_socket():
    line = await opened()
    await line.send_to("?" * (MAX_LENGTH + 1))
    assert (await line.receive_output(timeout=patient(5)))["type"] == "websocket.close"
    await line.disconnect()


async def test_socket_closes_after_a_while(monkeypatch):
    monkeypatch.setattr("sessions.consumers.connection_check.SECONDS", 0.05)
    line = await opened()
    assert (await line.receive_output(timeout=patient(5)))["type"] == "websocket.close"
    await line.disconnect()
