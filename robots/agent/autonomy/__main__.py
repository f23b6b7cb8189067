"""The navigation process: `python -m robots.agent.autonomy PORT`, with its token on stdin.

A step of navigation takes milliseconds, sometimes tens of them: too long for a control loop or its
interpreter. The process ends with its socket.
"""

import logging
import select
import socket
import sys
from collections.abc import Callable, Sequence

import numpy as np
import structlog

from robots.agent.autonomy import wire
from robots.agent.autonomy.area import AreaError, area_of
from robots.agent.autonomy.navigation_node import ActionError, NavigationNode
from robots.process import framing
from robots.process.ending import interrupted_by_signals
from robots.process.logs import reason_of
from robots.world.sensing import LaserScan

log = structlog.stdlib.get_logger(__name__)
PIECE = 256 << 10


class Conversation:
    """Serves one control loop; `send` puts a message on the socket."""

    def __init__(self, send: Callable[[wire.NodeMessage], None]) -> None:
        self._send = send
        self._node: NavigationNode | None = None
        self._beams: LaserScan | None = None

    def take(self, messages: Sequence[wire.ToNode]) -> None:
        """Handle messages in order, and only the newest snapshot. Raises WireError for an invalid
        one.
        """
        newest: wire.Perceive | None = None
        for message in messages:
            if isinstance(message, wire.Perceive):
                newest = message
                self._beams = wire.beams_in(message.sweep) if message.sweep else self._beams
            else:
                self._obey(message)
        if newest is not None and self._node is not None:
            self._send(wire.NodeOutput(self._node.step(wire.perceived(newest, self._beams))))

    def _obey(self, message: wire.ToNode) -> None:
        match message:
            case wire.Settle():
                self._send(wire.Settled(self._settle(message)))
            case wire.KnownPlace(pose, spread, turn) if self._node is not None:
                self._node.place(pose, spread, turn)
            case wire.BeginAction(number, _):
                self._send(wire.OrderReply(number, self._begin(message)))
            case wire.CancelAction(action_id) if self._node is not None:
                self._node.cancel(action_id)
            case wire.FindRoute(number, x, y) if self._node is not None:
                self._send(wire.FoundRoute(number, *self._node.preview(x, y)))
            case _:
                log.warning("message_too_early", message=type(message).__name__)

    def _settle(self, message: wire.Settle) -> str:
        try:
            self._node = NavigationNode(
                area_of(message.area), message.body, np.random.default_rng(message.seed)
            )
        except AreaError as error:
            return reason_of(error)
        return ""

    def _begin(self, order: wire.BeginAction) -> str:
        if self._node is None:
            return "no map"
        try:
            self._node.begin(order.action)
        except ActionError as error:
            return reason_of(error)
        return ""


def frames(buffer: bytearray) -> list[wire.ToNode]:
    """Take the whole messages off a buffer; raises WireError when it holds something else."""
    found = []
    while (body := framing.take(buffer)) is not None:
        found.append(wire.unpack_order(body))
    return found


def serve(link: socket.socket) -> None:
    """Answer until the other side is gone; raises OSError or WireError when it is broken."""
    conversation = Conversation(lambda message: link.sendall(framing.pack(message)))
    buffer = bytearray()
    while piece := link.recv(PIECE):
        buffer += piece
        # Take all that is there: after a delay, older snapshots are skipped.
        while select.select([link], [], [], 0.0)[0] and (piece := link.recv(PIECE)):
            buffer += piece
        conversation.take(frames(buffer))


def main(arguments: Sequence[str]) -> int:
    logging.basicConfig(
        level=logging.INFO,
        format="%(asctime)s %(levelname)s %(name)s %(message)s",
        stream=sys.stderr,
    )
    address = "127.0.0.1", int(arguments[0])
    try:
        with (
            interrupted_by_signals(),
            socket.create_connection(address, timeout=10.0) as link,
        ):
            link.settimeout(None)
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            link.sendall(sys.stdin.readline().encode())  # the token
            serve(link)
    except (OSError, framing.WireError) as error:
        log.warning("navigation_node_ended", reason=str(error))
        return 1
    except KeyboardInterrupt:
        return 0
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
