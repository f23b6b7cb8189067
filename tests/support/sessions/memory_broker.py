"""A broker in memory: what an agent publishes is decoded and kept in order, and a test speaks for
the server.

The agent's end lives on its control loop, the test's wherever the test is: messages may cross
threads, as they do in reality.
"""

import asyncio

from robots.agent.broker_link.outbox import Outbox, outbound
from robots.api import codec
from tests.support.virtual_time import RealTime


class MemoryLink:
    """The agent's end (ways_out.Link): connects at once, can be cut and mended, keeps what must not
    be lost meanwhile.
    """

    def __init__(self, time=RealTime):
        self.connected = False
        self.outbox = Outbox()
        # (suffix, message), decoded; only ever appended to, so that any thread may read it
        self.sent = []
        self._time = time
        self._loop = self._inbox = None
        self._closing = None

    # --- the agent's side -------------------------------------------------------------------------

    def publish(self, suffix, payload):
        self.outbox.put(outbound(suffix, payload), connected=self.connected)
        self._flush()

    async def run(self, inbox):
        self._loop, self._inbox, self._closing = asyncio.get_running_loop(), inbox, asyncio.Event()
        self._set_connected(True)
        await self._closing.wait()

    def close(self):
        self._closing.set()

    def _set_connected(self, up):
        self.connected = up
        self._inbox.link_changed(up=up)
        self._flush()

    def _flush(self):
        while self.connected and len(self.outbox):
            message = self.outbox.take()
            self.outbox.acknowledged(message)
            self.sent.append(
                (message.suffix, codec.decode(message.suffix, message.payload, "from_robot"))
            )

    # --- the server's side ------------------------------------------------------------------------

    def cut(self, *, mend=False):
        self._loop.call_soon_threadsafe(self._set_connected, mend)

    def say(self, suffix, message, *, retained=False):
        """Publish to the robot; a message of None takes back what was retained. Raises Rejection
        where the wire would.
        """
        decoded = (
            None if message is None else codec.decode(suffix, codec.encode(message), "to_robot")
        )
        self._loop.call_soon_threadsafe(
            lambda: self._inbox.arrived(suffix, decoded, retained=retained)
        )

    def say_bytes(self, suffix, payload):
        """Publish bytes of any kind, as MqttLink would take them."""

        def take():
            try:
                self._inbox.arrived(
                    suffix, codec.decode(suffix, payload, "to_robot"), retained=False
                )
            except codec.Rejection as rejection:
                self._inbox.rejected(rejection.reason)

        self._loop.call_soon_threadsafe(take)

    def all(self, suffix):
        return [message for name, message in self.sent if name == suffix]

    def wait(self, suffix, wanted=lambda _: True, *, since=0, within=5.0):
        """Wait for a message of the robot that `wanted` accepts, the `since`-th or later of all,
        and return it.
        """
        found = []

        def has_come():
            nonlocal since
            until = len(self.sent)
            found.extend(
                message
                for name, message in self.sent[since:until]
                if name == suffix and wanted(message)
            )
            since = until
            return found

        self._time.wait(
            has_come,
            within,
            lambda: f"such a {suffix} (the last of {len(self.sent)}: {self.sent[-5:]})",
        )
        return found[0]

    @property
    def count(self):
        return len(self.sent)
