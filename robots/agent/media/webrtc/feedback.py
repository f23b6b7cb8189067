"""When each packet arrived at a viewer, by transport-wide feedback
(draft-holmer-rmcat-transport-wide-cc-extensions-01). Pure.

Browsers send it ten to twenty times a second. It shows how long packets wait before a bottleneck,
without the camera's interval, retransmissions, and the time that a busy computer needs for a
picture.
"""

import struct
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass

NUMBERS = 1 << 16
MOST_UNREPORTED = 4096  # packets; about 30 s of the best layer
_RTPFB, _FORMAT = 205, 15
_TICK, _REFERENCE = 0.000_25, 0.064  # s, units of a difference and of the reference time
_PERIOD = (1 << 24) * _REFERENCE  # s after which the reference time wraps


@dataclass(frozen=True)
class ArrivalReport:
    """What one feedback message says.

    `sent_at` is when the quickest packet was sent (monotonic s), `delay` how long it took (s, from
    an unknown origin, as the viewer's clock is another). `lost` of `expected` packets that had not
    been reported before; negative when a packet arrives that was reported as lost.
    """

    sent_at: float
    delay: float
    expected: int
    lost: int


class SentPackets:
    """The packets that no feedback has reported as arrived, by their transport-wide number."""

    def __init__(self) -> None:
        # when each was sent, and whether it was reported as lost
        self._packets: OrderedDict[int, tuple[float, bool]] = OrderedDict()
        self._origin: float | None = None

    def add(self, number: int, now: float) -> None:
        self._packets[number] = now, False
        if len(self._packets) > MOST_UNREPORTED:
            self._packets.popitem(last=False)

    def deliveries(self, rtcp: bytes) -> Iterator[ArrivalReport]:
        """Return what an RTCP packet, which may consist of several, says about deliveries."""
        while len(rtcp) >= 4:
            kind, end = rtcp[1], 4 + 4 * int.from_bytes(rtcp[2:4], "big")
            if kind == _RTPFB and rtcp[0] & 0x1F == _FORMAT:
                delivery = self._delivery(arrivals(rtcp[:end]))
                if delivery is not None:
                    yield delivery
            rtcp = rtcp[end:]

    def _delivery(self, reported: list[tuple[int, float | None]]) -> ArrivalReport | None:
        expected = lost = 0
        quickest: tuple[float, float] | None = None
        for number, arrived in reported:
            if number not in self._packets:
                continue
            sent_at, was_lost = self._packets[number]
            expected += not was_lost
            if arrived is None:
                lost += not was_lost
                self._packets[number] = sent_at, True
                continue
            lost -= was_lost
            del self._packets[number]
            delay = self._delay(arrived - sent_at)
            if quickest is None or delay < quickest[0]:
                quickest = delay, sent_at
        return None if quickest is None else ArrivalReport(quickest[1], quickest[0], expected, lost)

    def _delay(self, difference: float) -> float:
        """Return a delay that does not jump where the viewer's reference time wraps."""
        if self._origin is None:
            self._origin = difference
        return (difference - self._origin + _PERIOD / 2) % _PERIOD - _PERIOD / 2


def arrivals(packet: bytes) -> list[tuple[int, float | None]]:
    """Return (number, time of arrival by the viewer's clock in s, None for a lost packet) of one
    feedback message; nothing of a message that is cut off.
    """
    try:
        first, count, time_and_count = struct.unpack_from("!HHL", packet, 12)
        symbols, position = _symbols(packet, count)
        at, found = (time_and_count >> 8) * _REFERENCE, list[tuple[int, float | None]]()
        for offset, symbol in enumerate(symbols):
            arrived = None
            if symbol == 1:
                at += packet[position] * _TICK
                position += 1
            elif symbol == 2:
                at += struct.unpack_from("!h", packet, position)[0] * _TICK
                position += 2
            if symbol in (1, 2):
                arrived = at
            found.append(((first + offset) % NUMBERS, arrived))
    except (struct.error, IndexError):
        return []
    return found


def _symbols(packet: bytes, count: int) -> tuple[list[int], int]:
    """Return the symbols of `count` packets (0: lost; 1, 2: the size of the difference), and where
    the differences begin.
    """
    symbols: list[int] = []
    position = 20
    while len(symbols) < count:
        (chunk,) = struct.unpack_from("!H", packet, position)
        position += 2
        if not chunk & 0x8000:  # a run of one symbol
            symbols += [chunk >> 13 & 3] * (chunk & 0x1FFF)
        elif chunk & 0x4000:  # seven symbols of two bits
            symbols += [chunk >> shift & 3 for shift in range(12, -1, -2)]
        else:  # fourteen symbols of one bit
            symbols += [chunk >> shift & 1 for shift in range(13, -1, -1)]
    return symbols[:count], position
