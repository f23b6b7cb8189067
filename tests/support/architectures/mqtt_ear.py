"""A server's client of a real broker, in a thread of its own, which subscribes to all topics of a
robot.
"""

import threading
import time

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from robots.api import codec, topics
from robots.api.errors import Rejection
from tests.support.patience import patient


class Ear:
    """Use as a context manager; it reconnects by itself."""

    def __init__(self, port, robot="giraff"):
        self.robot = robot
        self.heard = []  # (suffix, message, retained)
        self._news = threading.Condition()
        self._client = paho.Client(CallbackAPIVersion.VERSION2)
        self._client.reconnect_delay_set(0.05, 0.2)
        self._client.on_connect = lambda client, *_: client.subscribe(topics.of(robot, "#"), qos=1)
        self.subscribed = threading.Event()
        self._client.on_subscribe = lambda *_: self.subscribed.set()
        self._client.on_message = self._hear
        self._client.max_inflight_messages_set(1000)
        self._client.connect_async("127.0.0.1", port, keepalive=60)

    def __enter__(self):
        self._client.loop_start()
        assert self.subscribed.wait(patient(10.0))
        return self

    def __exit__(self, *_):
        self._client.disconnect()
        self._client.loop_stop()

    def _hear(self, _client, _data, delivery):
        suffix = topics.parse(delivery.topic)[1]
        try:
            message = codec.decode(suffix, delivery.payload) if delivery.payload else None
        except Rejection:
            return  # malformed messages of the test itself
        with self._news:
            self.heard.append((suffix, message, bool(delivery.retain)))
            self._news.notify_all()

    def say(self, suffix, message, *, retain=False, raw=None):
        payload = raw if raw is not None else b"" if message is None else codec.encode(message)
        self._client.publish(
            topics.of(self.robot, suffix), payload, qos=1, retain=retain
        ).wait_for_publish(patient(10.0))

    def all(self, suffix):
        with self._news:
            return [message for name, message, _ in self.heard if name == suffix]

    @property
    def count(self):
        with self._news:
            return len(self.heard)

    def wait(self, suffix, wanted=lambda _: True, *, since=0, within=15.0):
        deadline = time.monotonic() + patient(within)
        with self._news:
            while True:
                for name, message, _ in self.heard[since:]:
                    if name == suffix and wanted(message):
                        return message
                self._news.wait(deadline - time.monotonic())
                if time.monotonic() >= deadline:
                    received = [name for name, *_ in self.heard[-30:]]
                    raise AssertionError(f"no such {suffix}; received {received}")
