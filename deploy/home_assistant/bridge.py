"""A robot in Home Assistant: reads the site's JSON API, and offers the robot by MQTT discovery at
Home Assistant's own broker.

    TELEPRESENCE_KEY=… python3 bridge.py --site https://robots.example.org --robot giraff --broker
    mqtt://user:password@homeassistant.local:1883

Needs paho-mqtt and nothing else of ours: a worked example of a program that uses
docs/reference/json-api.md. Home Assistant shows the robot's state, charge and visitors, and three
buttons: stop, emergency stop, go to the charging station. A button that is pressed while this
program does not run has no effect later: retained commands are ignored, and none is stored.
"""

import argparse
import json
import logging
import os
import queue
import signal
import threading
import time
import urllib.error
import urllib.request
from typing import Any
from urllib.parse import unquote, urlsplit

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

log = logging.getLogger("home_assistant_bridge")
SECONDS = 5.0  # between two requests of the state
TIMEOUT = 5.0
STALE_SECONDS = 3.0  # a press that waited longer for its turn is forgotten
ACTIONS = {"stop": "Stop", "estop": "Emergency stop", "dock": "Go to the charging station"}


class TelepresenceSite:
    """The JSON API of one robot."""

    def __init__(self, site: str, robot: str, key: str) -> None:
        self._url, self._key = f"{site.rstrip('/')}/api/v1/robots/{robot}/", key

    def state(self) -> dict[str, Any]:
        """Return the robot's fields; OSError or ValueError when there is no sensible answer."""
        answer: dict[str, Any] = self._ask(self._url)["robot"]
        return answer

    def act(self, kind: str) -> None:
        """Have the robot do something; OSError with the site's reason when it does not."""
        self._ask(f"{self._url}actions/", json.dumps({"type": kind}).encode())

    def _ask(self, url: str, body: bytes | None = None) -> Any:
        headers = {"Authorization": f"Bearer {self._key}", "Content-Type": "application/json"}
        with urllib.request.urlopen(
            urllib.request.Request(url, body, headers),
            timeout=TIMEOUT,
        ) as answer:
            return json.loads(answer.read())


PERCENT = "{{ (value_json.charge * 100) | round(0) if value_json.charge is not none else none }}"


def components(name: str, base: str) -> dict[str, Any]:
    """Return the descriptions of a robot's sensors and buttons for MQTT discovery, by name."""
    called = name.replace("-", "_")

    def part(kind: str, own: str, label: str, **more: Any) -> dict[str, Any]:
        return {
            "platform": kind,
            "unique_id": f"telepresence_{name}_{own}",
            "default_entity_id": f"{kind}.{called}_{own}",
            "name": label,
            **more,
        }

    def value(own: str, label: str, template: str, **more: Any) -> dict[str, Any]:
        return part("sensor", own, label, value_template=template, **more)

    def truth(own: str, label: str, **more: Any) -> dict[str, Any]:
        value = f"value_json.{own}"
        template = f"{{{{ none if {value} is none else 'ON' if {value} else 'OFF' }}}}"
        return part("binary_sensor", own, label, value_template=template, **more)

    battery = {"device_class": "battery", "unit_of_measurement": "%"}
    waiting = "{{ value_json.waiting }}"
    sensors = {
        "state": value("state", "State", "{{ value_json.state }}", icon="mdi:robot"),
        "charge": value("charge", "Charge", PERCENT, **battery),
        "waiting": value("waiting", "Visitors waiting", waiting, icon="mdi:account-clock"),
        "driven": truth("driven", "Visitor", device_class="occupancy"),
        "charging": truth("charging", "Charging", device_class="battery_charging"),
        "docked": truth("docked", "Docked", icon="mdi:ev-station"),
    }
    buttons = {
        kind: part("button", kind, label, command_topic=f"{base}/command", payload_press=kind)
        for kind, label in ACTIONS.items()
    }
    return sensors | buttons


def discovery(robot: dict[str, Any], base: str) -> dict[str, Any]:
    """Return the robot's message for MQTT discovery: a device with its sensors and buttons."""
    return {
        "device": {
            "identifiers": [f"telepresence_{robot['name']}"],
            "name": robot["title"],
            "model": robot["series"],
            "configuration_url": robot["page"],
        },
        "origin": {"name": "telepresence"},
        "availability_topic": f"{base}/availability",
        "state_topic": f"{base}/state",
        "components": components(robot["name"], base),
    }


class HomeAssistantBridge:
    """Between the site and Home Assistant's broker, until `stop`."""

    def __init__(
        self, site: TelepresenceSite, robot: str, broker: str, period: float = SECONDS
    ) -> None:
        self._site, self._robot, self._period = site, robot, period
        self.base = f"telepresence_bridge/{robot}"
        self._presses: queue.Queue[tuple[str, float]] = queue.Queue(maxsize=8)
        self._stopping, self._announce = threading.Event(), threading.Event()
        parts = urlsplit(broker)
        self._client = paho.Client(CallbackAPIVersion.VERSION2)
        self._client.username_pw_set(unquote(parts.username or ""), unquote(parts.password or ""))
        if parts.scheme == "mqtts":
            self._client.tls_set()
        self._client.will_set(f"{self.base}/availability", "offline", qos=1, retain=True)
        self._client.on_connect, self._client.on_message = self._connected, self._on_message
        self._client.connect_async(
            parts.hostname or "localhost", parts.port or (8883 if parts.scheme == "mqtts" else 1883)
        )

    def run(self) -> None:
        """Look at the robot again and again; presses are carried out beside it, so that a slow site
        delays no stop.
        """
        pressing = threading.Thread(target=self._carry_out, daemon=True)
        pressing.start()
        self._client.loop_start()
        while not self._stopping.is_set():
            self._look()
            self._stopping.wait(self._period)
        self._client.publish(f"{self.base}/availability", "offline", qos=1, retain=True)
        self._client.disconnect()
        self._client.loop_stop()

    def stop(self, *_: object) -> None:
        """Have `run` say good-bye and return."""
        self._stopping.set()

    def _look(self) -> None:
        try:
            robot = self._site.state()
        except (OSError, ValueError, KeyError) as error:
            log.warning("site_away reason=%s", error)
            self._client.publish(f"{self.base}/availability", "offline", qos=1, retain=True)
            return
        if self._announce.is_set():
            self._announce.clear()
            self._client.publish(
                f"homeassistant/device/telepresence_{self._robot}/config",
                json.dumps(discovery(robot, self.base)),
                qos=1,
                retain=True,
            )
        self._client.publish(f"{self.base}/availability", "online", qos=1, retain=True)
        self._client.publish(f"{self.base}/state", json.dumps(robot), qos=1)

    def _connected(self, client: paho.Client, *_: Any) -> None:
        client.subscribe([(f"{self.base}/command", 1), ("homeassistant/status", 1)])
        self._announce.set()

    def _on_message(self, _client: paho.Client, _data: Any, message: paho.MQTTMessage) -> None:
        payload = message.payload.decode("utf-8", "replace")
        if message.topic == "homeassistant/status":
            self._announce.set()  # Home Assistant has restarted and lost the discovery
        elif payload in ACTIONS and not message.retain:
            try:
                self._presses.put_nowait((payload, time.monotonic()))
            except queue.Full:
                log.warning("press_dropped action=%s", payload)

    def _carry_out(self) -> None:
        while True:
            kind, pressed = self._presses.get()
            if time.monotonic() - pressed > STALE_SECONDS:
                log.warning("press_too_old action=%s", kind)
                continue
            try:
                self._site.act(kind)
                log.info("acted action=%s", kind)
            except (OSError, ValueError) as error:
                log.warning("not_acted action=%s reason=%s", kind, error)


def main() -> None:
    """Run until SIGTERM or Ctrl-C."""
    parser = argparse.ArgumentParser(description="Offer a robot to Home Assistant.")
    parser.add_argument("--site", required=True, help="such as https://robots.example.org")
    parser.add_argument("--robot", required=True, help="its name on the site")
    parser.add_argument(
        "--broker",
        required=True,
        help="Home Assistant's broker: mqtt:// or mqtts://user:password@host:port",
    )
    parser.add_argument(
        "--period", type=float, default=SECONDS, help="seconds between two polls (5)"
    )
    options = parser.parse_args()
    key = os.environ.get("TELEPRESENCE_KEY")
    if not key:
        parser.error(
            "TELEPRESENCE_KEY is not set: manage.py api_key ROBOT home-assistant makes one."
        )
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
    bridge = HomeAssistantBridge(
        TelepresenceSite(options.site, options.robot, key),
        options.robot,
        options.broker,
        options.period,
    )
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, bridge.stop)
    bridge.run()


if __name__ == "__main__":
    main()
