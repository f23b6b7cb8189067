"""The example for Home Assistant, with a real Mosquitto as its broker and an API that keeps what it
was asked.
"""

import contextlib
import http.server
import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import paho.mqtt.client as paho
import pytest
from django.conf import settings as site
from paho.mqtt.enums import CallbackAPIVersion

from tests.support.patience import patient
from tests.support.programs.mosquitto import Mosquitto
from tests.support.sessions.site import wait_for

pytestmark = pytest.mark.broker
BRIDGE = Path(site.BASE_DIR) / "deploy/home_assistant/bridge.py"
ROBOT = {
    "name": "giraff",
    "title": "Giraff",
    "series": "Giraff",
    "page": "http://robots/giraff/",
    "state": "available",
    "charge": 0.5,
    "waiting": 0,
    "driven": False,
    "charging": False,
    "docked": True,
}
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
        self.server.asked.append(
            (self.path, json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        )
        self._answer({"apiVersion": 1})

    def _answer(self, content):
        self.server.keys.add(self.headers["Authorization"])
        self.send_response(503 if self.server.away else 200)
        self.end_headers()
        self.wfile.write(json.dumps(content).encode())

    def log_message(self, *_):
        pass


class HomeAssistant:
    """A client of its broker that hears everything; `heard` has the last words on each topic."""

    def __init__(self, port):
        self.heard, self._ready = {}, threading.Event()
        self.client = paho.Client(CallbackAPIVersion.VERSION2)
        self.client.on_message = lambda _client, _data, message: self.heard.__setitem__(
            message.topic, message.payload.decode()
        )
        self.client.on_subscribe = lambda *_: self._ready.set()
        self.client.connect("127.0.0.1", port)
        self.client.loop_start()
        self.client.subscribe("#", qos=1)
        assert self._ready.wait(patient(10))

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
            config = json.loads(wait_for(lambda: home.heard.get(CONFIG), 10, "the discovery"))
            assert {name: part["platform"] for name, part in config["components"].items()} == {
                "state": "sensor",
                "charge": "sensor",
                "waiting": "sensor",
                "driven": "binary_sensor",
                "charging": "binary_sensor",
                "docked": "binary_sensor",
                "stop": "button",
                "estop": "button",
                "dock": "button",
            }
            named = {name: part["default_entity_id"] for name, part in config["components"].items()}
            assert (named["driven"], named["dock"]) == (
                "binary_sensor.giraff_driven",
                "button.giraff_dock",
            )  # as the documentation's automation has it
            assert (
                wait_for(
                    lambda: json.loads(home.heard.get(config["state_topic"], "{}")), 10, "a state"
                )
                == ROBOT
            )
            wait_for(
                lambda: home.heard.get(config["availability_topic"]) == "online", 10, "availability"
            )
            button = config["components"]["stop"]
            home.say(button["command_topic"], button["payload_press"])
            home.say(button["command_topic"], "drive")
            home.say(button["command_topic"], "dock")
            wait_for(lambda: len(api.asked) >= 2, 10, "both presses")
            assert sorted(kind["type"] for _, kind in api.asked) == ["dock", "stop"], (
                "the old press and the unknown one are not carried out"
            )
            assert {path for path, _ in api.asked} == {"/api/v1/robots/giraff/actions/"}
            assert api.keys == {"Bearer the-key"}
            api.away = True
            wait_for(
                lambda: home.heard.get(config["availability_topic"]) == "offline",
                10,
                "the site's absence",
            )
            api.away = False
            wait_for(
                lambda: home.heard.get(config["availability_topic"]) == "online", 10, "its return"
            )
            del home.heard[CONFIG]
            home.say("homeassistant/status", "online")
            wait_for(
                lambda: CONFIG in home.heard,
                10,
                "the discovery again, for a Home Assistant that has started anew",
            )
        wait_for(
            lambda: home.heard.get(config["availability_topic"]) == "offline", 10, "its good-bye"
        )
        home.client.disconnect()
        home.client.loop_stop()
    api.shutdown()


def test_without_a_key_it_says_how_to_make_one():
    environment = {name: value for name, value in os.environ.items() if name != "TELEPRESENCE_KEY"}
    arguments = ["--site", "http://x", "--robot", "giraff", "--broker", "mqtt://x"]
    done = subprocess.run(
        [sys.executable, str(BRIDGE), *arguments],
        env=environment,
        capture_output=True,
        text=True,
        timeout=patient(20),
        check=False,
    )
    assert done.returncode == 2
    assert "manage.py api_key" in done.stderr
