"""A bridge without a broker: what pages send is kept in lists, what a robot says is brought at
once.
"""

import asyncio
import collections
import time

from robots.api import codec, picture, topics
from robots.bridge.delivery import LINK, Delivery, ReceivedMessage
from sessions import protocol


class MemoryBridge:
    """Stands in for robots.bridge.bridge.Bridge. `sent` holds (robot, suffix, message), `leases`
    (robot, lease or None).
    """

    def __init__(self):
        self.delivery = Delivery()
        self.connected = True
        self.stored = {}
        self.counts = collections.Counter()
        self.sent, self.stops, self.leases = [], [], []
        self.notices, self.reports = [], []

    def serves(self, _loop):
        return True

    async def wait_connected(self, _seconds):
        return self.connected

    # --- what consumers call ---

    def listen(self, robot, listener, *, needs=True):
        if self.delivery.listen(robot, listener, time.monotonic(), needs=needs):
            asyncio.get_running_loop().call_soon(self._bring_stored, robot)
        return self.delivery.known[robot]

    def _bring_stored(self, robot):
        for (name, suffix), payload in self.stored.items():
            if name == robot:
                self.delivery.arrive(topics.of(robot, suffix), payload, time.monotonic())

    def ignore(self, robot, listener):
        self.delivery.ignore(robot, listener)

    def follow(self, session, listener):
        self.delivery.follow(session, listener)

    def unfollow(self, session, listener):
        self.delivery.unfollow(session, listener)

    def send(self, robot, suffix, message):
        if self.connected:
            # As it would arrive, so that what cannot be encoded fails here.
            self.sent.append(
                (robot, suffix, codec.decode(suffix, codec.encode(message), "to_robot"))
            )
        return self.connected

    def send_stop(self, robot, action):
        self.stops.append((robot, action))

    def publish_lease(self, robot, lease):
        self.delivery.note_lease(robot, lease, time.monotonic())
        self.leases.append((robot, lease))
        return self.connected

    def publish_notice(self, session, frame):
        self.notices.append(protocol.decode_notice(frame))
        self.delivery.bring_notice(session, frame)
        return self.connected

    def notify(self, notice):
        """As the session manager does."""
        self.publish_notice(notice.session, protocol.notice_frame(notice))

    def report(self, topic, message):
        self.reports.append((topic, message))

    # --- what a test does ---

    def say(self, robot, suffix, message, *, stored=False):
        """The robot, or a server, publishes a message; None is an empty one."""
        payload = b"" if message is None else codec.encode(message)
        if stored:
            self.stored[robot, suffix] = payload
        self.delivery.arrive(topics.of(robot, suffix), payload, time.monotonic())

    def say_picture(self, robot, stamp, jpeg, peer=None):
        """The robot sends a picture through the server, for one peer or for all who have asked."""
        self.delivery.arrive(
            topics.of(robot, picture.suffix_for(peer)), picture.pack(stamp, jpeg), time.monotonic()
        )

    def lose_broker(self):
        self.connected = False
        self.delivery.lose_sight()
        self.delivery.bring_everybody(ReceivedMessage(LINK, False))

    def find_broker(self):
        self.connected = True
        self.delivery.bring_everybody(ReceivedMessage(LINK, True))

    def commands(self, suffix="command/velocity"):
        return [message for _, sent, message in self.sent if sent == suffix]
