"""The example for Home Assistant, with a real Mosquitto as its broker and an API that notes its
requests.
"""

import contextlib
import http.server
import json
import os
import subprocess
import sys
import threading

import paho.mqtt.client as paho
import pytest
from paho.mqtt.enums import CallbackAPIVersion

from tests.support.paths import ROOT
from tests.support.patience import patient
from tests.support.programs.finished import run
from tests.support.programs.mosquitto import Mosquitto
from tests.support.sessions.site import wait_for

pytestmark = pytest.mark.broker
BRIDGE = ROOT / "deploy/home_assistant/bridge.py"
ROBOT = {"name": "giraff", "title": "Giraff", "series": "Giraff", "page": "http://robots/giraff/"}
ROBOT |= {"state": "available", "charge": 0.5, "waiting": 0}
ROBOT |= {"driven": False, "charging": False, "docked": True}
BASE = "telepresence_bridge/giraff"
CONFIG = "homeassistant/device/telepresence_giraff/config"


class Api(http.server.ThreadingHTTPServer):
    """Answers as the site does; `away` makes it fail."""

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Answer)
        self.asked, self.away, self.keys = [], False, set()
        threading.Thread(target=self.serve_forever, daemon=True).start()

    @property
    def url(self):
        return f"http://127.0.0.1:{self.server_port}"


class Answer(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        self._answer({"apiVersion": 1, "robot": ROBOT})

    def do_POST(self):
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.asked.append((self.path, json.loads(body)))
        self._answer({"apiVersion": 1})

    def _answer(self, content):
        self.server.keys.add(self.headers["Authorization"])
        self.send_response(503 if self.server.away else 200)
        self.end_headers()
        self.wfile.write(json.dumps(content).encode())

    def log_message(self, *_):
        pass


class HomeAssistant:
    """A client of its broker; `received` has the last message of each topic."""

    def __init__(self, port):
        self.received, self._ready = {}, threading.Event()
        self.client = paho.Client(CallbackAPIVersion.VERSION2)
        self.client.on_message = self._receive
        self.client.on_subscribe = lambda *_: self._ready.set()
        self.client.connect("127.0.0.1", port)
        self.client.loop_start()
        self.client.subscribe("#", qos=1)
        assert self._ready.wait(patient(10))

    def _receive(self, _client, _data, message):
        self.received[message.topic] = message.payload.decode()

    def say(self, topic, words, *, retain=False):
        self.client.publish(topic, words, qos=1, retain=retain).wait_for_publish(patient(10))


@contextlib.contextmanager
def running_bridge(api, broker):
    environment = os.environ | {"TELEPRESENCE_KEY": "the-key"}
    arguments = ["--site", api.url, "--robot", "giraff", "--broker", broker.url, "--period", "0.1"]
    process = subprocess.Popen(
        [sys.executable, str(BRIDGE), *arguments], env=environment, stderr=subprocess.DEVNULL
    )
    try:
        yield process
    finally:
        process.terminate()
        process.wait(patient(10))


def test_home_assistant_shows_a_robot_and_its_buttons_work(tmp_path):
    api = Api()
    with Mosquitto(tmp_path) as broker:
        home = HomeAssistant(broker.port)
        home.say(f"{BASE}/command", "estop", retain=True)  # pressed long ago
        with running_bridge(api, broker):
            config = json.loads(wait_for(lambda: home.received.get(CONFIG), 10, "the discovery"))
            parts = config["components"]
            assert {name: part["platform"] for name, part in parts.items()} == {
                **dict.fromkeys(("state", "charge", "waiting"), "sensor"),
                **dict.fromkeys(("driven", "charging", "docked"), "binary_sensor"),
                **dict.fromkeys(("stop", "estop", "dock"), "button"),
            }
            # as in the documentation's automation
            assert parts["driven"]["default_entity_id"] == "binary_sensor.giraff_driven"
            assert parts["dock"]["default_entity_id"] == "button.giraff_dock"
            state = lambda: json.loads(home.received.get(config["state_topic"], "{}"))
            assert wait_for(state, 10, "a state") == ROBOT
            available = lambda: home.received.get(config["availability_topic"])
            wait_for(lambda: available() == "online", 10, "availability")
            button = parts["stop"]
            home.say(button["command_topic"], button["payload_press"])
            home.say(button["command_topic"], "drive")
            home.say(button["command_topic"], "dock")
            wait_for(lambda: len(api.asked) >= 2, 10, "both presses")
            kinds = sorted(kind["type"] for _, kind in api.asked)
            assert kinds == ["dock", "stop"], "the old press and the unknown one are ignored"
            assert {path for path, _ in api.asked} == {"/api/v1/robots/giraff/actions/"}
            assert api.keys == {"Bearer the-key"}
            api.away = True
            wait_for(lambda: available() == "offline", 10, "the site's absence")
            api.away = False
            wait_for(lambda: available() == "online", 10, "its return")
            del home.received[CONFIG]
            home.say("homeassistant/status", "online")
            wait_for(lambda: CONFIG in home.received, 10, "discovery after a restart")
        wait_for(lambda: available() == "offline", 10, "its last message")
        home.client.disconnect()
        home.client.loop_stop()
    api.shutdown()


def test_missing_key_is_reported_with_how_to_create_one():
    environment = {name: value for name, value in os.environ.items() if name != "TELEPRESENCE_KEY"}
    arguments = ["--site", "http://x", "--robot", "giraff", "--broker", "mqtt://x"]
    done = run(sys.executable, str(BRIDGE), *arguments, env=environment)
    assert done.returncode == 2
    assert "manage.py api_key" in done.stderr
