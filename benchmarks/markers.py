"""Markers over the Lab Streaming Layer between two processes of this computer, on loopback alone.

Each marker carries the Unix time at which it was sent. Measured are how far the time that the other
process gives it lies from that, and how long it takes to arrive.

    python -m benchmarks.markers
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from uuid import uuid4

from benchmarks.table import keep, quantiles

MARKERS, PAUSE_S, LIMIT_S = 500, 0.01, 60.0
ERROR_MS, TRANSIT_MS = 5.0, 5.0
LOOPBACK = """[ports]
IPv6 = disable
[multicast]
ResolveScope = machine
ListenAddress = 127.0.0.1
[lab]
KnownPeers = {127.0.0.1}
[log]
level = -2
"""


def publish(name: str) -> None:
    """Send markers once a consumer is connected, then wait for termination."""
    from experiments.markers.lsl import MarkerOutlet

    outlet = MarkerOutlet(name, name)
    while not outlet.news():
        time.sleep(PAUSE_S)
    for _ in range(MARKERS):
        now = time.time()
        outlet.push(repr(now), now)
        time.sleep(PAUSE_S)
    sys.stdin.read()


def receive(name: str) -> tuple[list[float], list[float]]:
    """Return the errors of the times and the transits of all markers, ms."""
    from experiments.markers.lsl import MarkerInlet

    inlet, errors, transits = MarkerInlet(name), [], []
    until = time.monotonic() + LIMIT_S
    while len(errors) < MARKERS and time.monotonic() < until:
        markers, _news = inlet.poll()
        arrived = time.time()
        for marker in markers:
            errors.append(abs(marker.at - float(marker.text)) * 1000.0)
            transits.append((arrived - float(marker.text)) * 1000.0)
        time.sleep(0.0002)
    return errors, transits


def main() -> int:
    name = f"benchmark-{uuid4().hex}"
    with tempfile.TemporaryDirectory(prefix="telepresence-markers-") as folder:
        settings = Path(folder) / "lsl_api.cfg"
        settings.write_text(LOOPBACK)
        os.environ["LSLAPICFG"] = str(settings)
        command = [sys.executable, "-m", "benchmarks.markers", name]
        with subprocess.Popen(command, stdin=subprocess.PIPE) as publisher:
            errors, transits = receive(name)
            publisher.communicate(b"")
    if len(errors) < MARKERS:
        raise SystemExit(f"{len(errors)} of {MARKERS} markers arrived")
    return keep(
        "markers",
        [
            *quantiles("error of a marker's time", errors, "ms", p50=None, p99=None, max=ERROR_MS),
            *quantiles("transit of a marker", transits, "ms", p50=TRANSIT_MS, p95=None),
        ],
    )


if __name__ == "__main__":
    if len(sys.argv) > 1:
        publish(sys.argv[1])
    else:
        sys.exit(main())
