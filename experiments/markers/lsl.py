"""Streams of the Lab Streaming Layer. Needs the extra `lsl`, whose wheel brings liblsl.

LSL's clock is monotonic and differs from computer to computer. A stamp of ours is the server's time
by this computer's LSL clock; a stamp of theirs is converted the other way round, after LSL's own
correction of their clock (some 0.2 ms on one network).
"""

import time

import pylsl
from pylsl.util import LostError, TimeoutError as LateError

from experiments.markers.incoming import ForeignMarker

TYPE = "Markers"  # as LSL calls streams of texts at irregular times
OPEN_S = 1.0  # to wait for a stream that has been found
AT_ONCE = 1024
READINGS = 5


def unix_minus_lsl() -> float:
    """Return this computer's Unix time minus its LSL clock, s: of several readings the one between
    the closest readings of the LSL clock, because a busy computer may pause in between.
    """
    readings = []
    for _ in range(READINGS):
        before, unix, after = float(pylsl.local_clock()), time.time(), float(pylsl.local_clock())
        readings.append((after - before, unix - (before + after) / 2.0))
    return min(readings)[1]


class MarkerOutlet:
    """A stream of markers, with a constant id by which a recorder finds it after a restart."""

    def __init__(self, name: str, source_id: str) -> None:
        info = pylsl.StreamInfo(name, TYPE, 1, pylsl.IRREGULAR_RATE, pylsl.cf_string, source_id)
        info.desc().append_child_value("manufacturer", "telepresence")
        self._outlet = pylsl.StreamOutlet(info)
        self._had_consumers = False

    def push(self, text: str, at: float) -> None:
        """Publish a marker of a Unix time; one from before the LSL clock began is left out."""
        stamp = at - unix_minus_lsl()
        if stamp > 0:
            self._outlet.push_sample([text], stamp)

    def news(self) -> str:
        """Return whether a recorder connected or left; "" when none did."""
        has = bool(self._outlet.have_consumers())
        if has == self._had_consumers:
            return ""
        self._had_consumers = has
        return "A recorder is connected." if has else "No recorder is connected any more."


class MarkerInlet:
    """A foreign stream by its name, searched for until it is found, and again when it is lost."""

    def __init__(self, name: str) -> None:
        self.name = name
        quoted = name.replace("'", "")
        self._resolver = pylsl.ContinuousResolver(pred=f"name='{quoted}'")
        self._inlet: pylsl.StreamInlet | None = None
        self._was_lost = False

    def poll(self) -> tuple[list[ForeignMarker], str]:
        """Return the new markers, and whether the stream was found or lost, "" when it was not."""
        if self._inlet is None:
            return [], self._connect()
        try:
            return self._pull(self._inlet), ""
        except (LostError, LateError):
            self._inlet, self._was_lost = None, True
            return [], f"Stream {self.name} is lost. Looking for it …"

    def _connect(self) -> str:
        """Open the stream when it is there; a lost one may still be announced for some seconds."""
        found = self._resolver.results()
        if not found:
            return ""
        inlet = pylsl.StreamInlet(found[0], recover=False)
        try:
            inlet.open_stream(timeout=OPEN_S)
            inlet.time_correction(timeout=OPEN_S)
        except (LostError, LateError):
            return ""
        self._inlet = inlet
        again = " again" if self._was_lost else ""
        return f"Stream {self.name} is connected{again}."

    def _pull(self, inlet: "pylsl.StreamInlet") -> list[ForeignMarker]:
        samples, stamps = inlet.pull_chunk(timeout=0.0, max_samples=AT_ONCE)
        if not stamps:
            return []
        offset = inlet.time_correction(timeout=OPEN_S) + unix_minus_lsl()
        texts = (" ".join(str(channel) for channel in sample) for sample in samples)
        return [
            ForeignMarker(self.name, text, stamp + offset)
            for text, stamp in zip(texts, stamps, strict=True)
        ]
