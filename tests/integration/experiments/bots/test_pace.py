import json
import os
import subprocess
import sys
import time
from itertools import pairwise

import pytest

from experiments.bots.pace import LATE, OLD, PROMPT, SLOWEST, Governor, Pace

RATE = 20.0
# Waits of every kind, and what each took by the process's own clock; `real` is the computer's,
# which is asked before and after, for a process may be held up between any two questions: the truth
# lies between the least and the most.
WAITS = """
import asyncio, json, queue, selectors, socket, sys, threading, time
from django.utils import timezone
real = sys.modules["sitecustomize"].clocks.real
def took(wait):
    before, begun, after = real(), time.monotonic(), real()
    wait()
    least, took, most = real(), time.monotonic(), real()
    return took - begun, least - after, most - before
def get():
    try: queue.Queue().get(timeout=1.0)
    except queue.Empty: pass
async def waits():
    for _ in range(50): await asyncio.sleep(0.02)
found = {
    "sleep": took(lambda: time.sleep(1.0)),
    "event": took(lambda: threading.Event().wait(1.0)),
    "queue": took(get),
    "asyncio": took(lambda: asyncio.run(asyncio.sleep(1.0))),
    "ticks": took(lambda: asyncio.run(waits())),
}
def timer():
    thread = threading.Timer(1.0, lambda: None)
    thread.start()
    thread.join()
found["thread"] = took(timer)
clocks = [time.time(), timezone.now().timestamp(), time.time()]
print(json.dumps({"waits": found, "clocks": clocks}))
"""


def started(pace, code):
    return subprocess.Popen(
        [sys.executable, "-c", code],
        env=pace.environment(dict(os.environ)),
        stdout=subprocess.PIPE,
        text=True,
    )


def test_waits_last_as_long_by_the_quick_clock_and_a_fraction_in_real_time(tmp_path):
    pace = Pace(tmp_path / "pace")
    pace.set(RATE)
    output, _ = started(pace, WAITS).communicate(timeout=60)
    for name, (quick, least, most) in json.loads(output)["waits"].items():
        assert quick >= 0.95, name
        assert 0.98 * RATE * least <= quick <= 1.02 * RATE * most, name


def test_all_processes_and_django_agree_on_the_time(tmp_path):
    pace = Pace(tmp_path / "pace")
    pace.set(RATE)
    # from outside inwards, for the reason above
    asked = "[r(), time.time(), time.monotonic(), time.time(), r()]"
    clock = (
        "import json, sys, time; r = sys.modules['sitecustomize'].clocks.real;"
        f" print(json.dumps({asked}))"
    )
    a, b = (json.loads(started(pace, clock).communicate(timeout=60)[0]) for _ in range(2))
    (
        (real_a, unix_a, first, unix_after_a, real_after_a),
        (real_b, unix_b, second, unix_after_b, real_after_b),
    ) = (
        a,
        b,
    )
    assert (
        0.99 * RATE * (real_b - real_after_a)
        <= second - first
        <= 1.01 * RATE * (real_after_b - real_a)
    )
    assert unix_b - unix_after_a - 0.01 <= second - first <= unix_after_b - unix_a + 0.01
    before, django, after = json.loads(started(pace, WAITS).communicate(timeout=60)[0])["clocks"]
    assert before - 0.5 <= django <= after + 0.5


def test_no_clock_jumps_when_the_pace_changes(tmp_path):
    now = 100.0
    pace = Pace(tmp_path / "pace", real=lambda: now, unix=lambda: 5000.0)
    clocks = started_clocks(pace, lambda: now)
    seen = [clocks.monotonic()]
    for rate in (5.0, 1.0, 12.0, 1.0):
        pace.set(rate)
        assert clocks.monotonic() == pytest.approx(seen[-1])
        now += 2.0
        seen.append(clocks.monotonic())
    assert [b - a for a, b in pairwise(seen)] == pytest.approx([10.0, 2.0, 24.0, 2.0])
    assert clocks.unix() == pytest.approx(5000.0 + 38.0)


def started_clocks(pace, real):
    from experiments.bots.fast_time.sitecustomize import Clocks

    clocks = Clocks(str(pace.path))
    clocks.real = real
    return clocks


def test_clocks_of_processes_without_a_pace_are_unchanged():
    assert time.monotonic.__name__ == "monotonic"
    assert (
        "sitecustomize" not in sys.modules
        or getattr(sys.modules["sitecustomize"], "clocks", None) is None
    )


def test_late_round_trips_slow_time_down_and_the_requested_pace_is_the_limit():
    governor = Governor(most=8.0)
    for _ in range(200):
        governor.decide([PROMPT / 2])
    assert governor.rate == 8.0
    assert governor.decide([LATE * 2, PROMPT / 2]) < 8.0
    for _ in range(200):
        governor.decide([LATE * 2])
    assert governor.rate == SLOWEST < 1.0


def test_without_drives_the_pace_of_the_last_drive_is_kept():
    governor = Governor(most=8.0)
    for _ in range(10):
        governor.decide([PROMPT / 2])
    reached = governor.rate
    for _ in range(200):
        governor.decide([])
    assert 1.0 < governor.rate == reached


def test_without_drives_a_slow_pace_rises_to_real_time_at_most():
    governor = Governor(most=8.0, rate=SLOWEST)
    for _ in range(200):
        governor.decide([], lag=PROMPT / 2)
    assert governor.rate == 1.0


def test_lag_of_the_bots_own_process_slows_time_down():
    governor = Governor(most=8.0, rate=4.0)
    assert governor.decide([PROMPT / 2], lag=LATE * 2) < 4.0
    assert governor.decide([], lag=LATE * 2) < 3.5


def test_old_images_slow_time_down_to_real_time_at_most():
    governor = Governor(most=8.0, rate=5.8)
    assert governor.decide([PROMPT / 2], ages=[0.40, OLD + 0.02]) < 5.8
    for _ in range(200):
        governor.decide([PROMPT / 2], ages=[2.0 * OLD])
    assert governor.rate == 1.0
    assert governor.decide([PROMPT / 2], ages=[0.40]) > 1.0
    governor.rate = SLOWEST
    assert governor.decide([PROMPT / 2], ages=[2.0 * OLD]) > SLOWEST
