"""The choice of layers on a network that is a queue before a line of some rate, with a page that
reports when packets arrived.
"""

import random
from collections import deque
from dataclasses import dataclass, field

import pytest

from robots.agent.media.codecs.encoder import LAYERS
from robots.agent.media.peers.bitrate import BitrateAdapter
from robots.agent.media.webrtc.feedback import ArrivalReport

RATES = tuple(tier.bitrate for tier in LAYERS)
BESIDE = 150_000.0  # bit/s of sound and messages
PACKET = 9_600.0  # bits
STEP = 0.01
REPORTS = 0.1  # s between two reports of the page


@dataclass
class Network:
    """`capacity` in bit/s; its queue takes half a second, first in, first out, and what finds it
    full is lost; of the rest the share `loss` is. The camera takes `fps` frames a second.
    """

    capacity: float
    adapter: BitrateAdapter = field(default_factory=lambda: BitrateAdapter(RATES, 0.0))
    now: float = 0.0
    loss: float = 0.0
    fps: float = 30.0
    # s by which the page reads two reports in ten late for no fault of the network
    busy_computer: float = 0.0
    beside: float = BESIDE
    delays: list[float] = field(default_factory=list)
    layers: list[int] = field(default_factory=list)
    rng: random.Random = field(default_factory=lambda: random.Random(5))
    # (bits, when it was sent, None for what is not video)
    queue: deque[tuple[float, float | None]] = field(default_factory=deque)
    room: float = 0.0  # bits that the line can still carry in this step
    arrived: list[tuple[float, float]] = field(default_factory=list)  # (delay, when sent)
    expected: int = 0
    lost: int = 0
    _frame_at: float = 0.0
    _report_at: float = 0.0

    def run(self, seconds: float, *, moving: float = 1.0) -> "Network":
        """`moving` is the share of its layer's rate that a frame needs: a still one little."""
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            self._put(self.beside * STEP, None)
            more = self.adapter.look(self.now)
            if self.now >= self._frame_at:
                layer = self.adapter.layer
                fps = min(self.fps, LAYERS[layer].fps)
                self._frame_at = max(self._frame_at + 1.0 / fps, self.now)
                if not self.adapter.pauses(self.now):
                    self._send(max(moving * RATES[layer], more) / fps)
            self._carry()
            if self.now >= self._report_at:
                self._report(moving * RATES[self.adapter.layer])
            self.layers.append(self.adapter.layer)
            self.delays.append(sum(bits for bits, _ in self.queue) / self.capacity)
        return self

    def _send(self, bits: float) -> None:
        while bits > 0.0:
            self.expected += 1
            if not self._put(min(bits, PACKET), self.now):
                self.lost += 1
            bits -= PACKET

    def _put(self, bits: float, sent: float | None) -> bool:
        if sum(held for held, _ in self.queue) + bits > 0.5 * self.capacity:
            return False
        self.queue.append((bits, sent))
        return sent is None or self.rng.random() >= self.loss

    def _carry(self) -> None:
        self.room = min(self.room, 0.0) + self.capacity * STEP
        while self.queue and self.room > 0.0:
            bits, sent = self.queue.popleft()
            self.room -= bits
            if sent is not None:
                self.arrived.append((self.now - sent, sent))

    def _report(self, sent: float) -> None:
        late = self.busy_computer if self.rng.random() < 0.2 else 0.0
        self._report_at = self.now + REPORTS + late
        if self.arrived:
            delay, sent_at = min(self.arrived)
            self.adapter.delivered(
                self.now, ArrivalReport(sent_at, delay - 17.0, self.expected, self.lost), sent
            )
            self.arrived, self.expected, self.lost = [], 0, 0


def test_a_wide_network_keeps_the_best_layer():
    for moving in (1.0, 0.05):
        assert set(Network(5e6).run(60.0, moving=moving).layers) == {0}


def test_a_page_on_a_busy_computer_keeps_the_layer():
    assert set(Network(5e6, busy_computer=0.4).run(30.0).layers) == {0}


@pytest.mark.parametrize("fps", [5.0, 6.0, 8.0, 10.0, 15.0, 30.0])
def test_camera_of_any_rate_has_the_best_layer_again_after_a_narrow_network(fps):
    network = Network(5e6, fps=fps).run(5.0)
    network.capacity = 3e5
    assert network.run(20.0).adapter.layer > 0
    network.capacity = 5e6
    network.run(10.0)
    network.layers = []
    assert set(network.run(30.0).layers) == {0}


@pytest.mark.parametrize("seed", range(6))
def test_ten_percent_of_loss_on_a_wide_network_keeps_the_best_layer(seed):
    network = Network(5e6, loss=0.1, rng=random.Random(seed))
    assert set(network.run(60.0).layers) == {0}


def test_one_lost_packet_in_a_short_report_keeps_the_layer():
    network = Network(5e6).run(5.0)
    for n in range(100):
        report = ArrivalReport(network.now, -17.0, 2, 1 if n % 20 == 0 else 0)
        network.adapter.delivered(network.now + 0.1 * n, report, RATES[0])
    assert network.adapter.layer == 0


@pytest.mark.parametrize("seed", range(6))
def test_400_kbits_get_the_fitting_layer_within_two_seconds_and_short_delays(seed):
    network = Network(5e6, rng=random.Random(seed)).run(5.0)
    network.capacity = 4e5
    network.run(2.0)
    assert RATES[network.adapter.layer] + BESIDE < 4e5
    network.run(7.0)
    network.delays, network.layers = [], []
    network.run(60.0)
    late = sorted(network.delays)
    assert late[int(0.95 * len(late))] < 0.2
    assert network.layers.count(3) > 0.7 * len(network.layers), "no lower than it must"


@pytest.mark.parametrize("seed", range(6))
def test_sudden_drop_to_200_kbits_is_answered_within_a_second_and_a_half(seed):
    network = Network(5e6, beside=8e4, rng=random.Random(seed)).run(5.0)
    network.capacity = 2e5
    network.run(1.5)
    assert RATES[network.adapter.layer] + network.beside < 2e5
    network.run(5.0)
    network.delays = []
    network.run(30.0)
    late = sorted(network.delays)
    assert late[int(0.95 * len(late))] < 0.25


@pytest.mark.parametrize("seconds", [5.0, 60.0])
def test_best_layer_returns_ten_seconds_after_the_network_is_wide_again(seconds):
    network = Network(5e6).run(5.0)
    network.capacity = 4e5
    network.run(seconds)
    network.capacity = 5e6
    network.layers = []
    network.run(20.0)
    assert network.layers.index(0) * STEP <= 10.0
    assert network.adapter.layer == 0


def test_a_network_too_narrow_for_every_layer_gets_the_lowest():
    network = Network(5e6).run(2.0)
    network.capacity = 1.5e5
    assert network.run(20.0).adapter.layer == len(RATES) - 1


def test_a_few_lost_packets_change_nothing_and_many_lower_the_layer():
    network = Network(5e6, loss=0.04).run(30.0)
    assert set(network.layers) == {0}
    network.loss = 0.3
    assert network.run(4.0).adapter.layer > 0


def test_failed_trials_delay_no_picture_and_become_rarer():
    network = Network(5e6).run(2.0)
    network.capacity = 3.8e5
    network.run(15.0)
    before, network.delays = network.adapter.probes, []
    network.run(60.0)
    assert max(network.delays) < 0.35
    assert 5 <= network.adapter.probes - before <= 24


def test_the_layer_does_not_change_without_reports_of_the_page():
    adapter = BitrateAdapter(RATES, 0.0)
    assert all(adapter.look(0.1 * step) == 0.0 for step in range(600))
    assert adapter.layer == 0


def test_single_layer_never_changes():
    adapter = BitrateAdapter((0,), 0.0)
    for n in range(10):
        adapter.delivered(0.2 * n, ArrivalReport(0.1 * n, 0.1 * n, 20, 10), 1e6)
    assert adapter.layer == 0
    assert adapter.look(60.0) == 0.0
