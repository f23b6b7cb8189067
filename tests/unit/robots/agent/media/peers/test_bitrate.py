"""The choice of layers on a network that is a queue before a line of some rate, with a page that
reports the age of its picture.
"""

import random
from collections import deque
from dataclasses import dataclass, field

import pytest

from robots.agent.media.codecs.encoder import LAYERS
from robots.agent.media.peers.bitrate import BitrateAdapter

RATES = tuple(tier.bitrate for tier in LAYERS)
BESIDE = 150_000.0  # bit/s of sound and messages
STEP = 0.05
# s older than at its best, beyond which a page reports more often (static/js/drive/scheduler.js)
HURRY = 0.1


@dataclass
class Network:
    """`capacity` in bit/s; its queue takes half a second, first in, first out, and what finds it
    full is lost.

    The page reports every 0.2 s, every 0.1 s while its picture is old, and lost packets every
    second.
    """

    capacity: float
    adapter: BitrateAdapter = field(default_factory=lambda: BitrateAdapter(RATES, 0.0))
    now: float = 0.0
    # (bits, when the picture in them was taken)
    queue: deque[tuple[float, float]] = field(default_factory=deque)
    loss: float = 0.0
    lost: float = 0.0
    taken: float = 0.0  # when the picture on the screen was
    # s by which two pictures in ten are late for no fault of the network
    busy_computer: float = 0.0
    delays: list[float] = field(default_factory=list)
    layers: list[int] = field(default_factory=list)
    rng: random.Random = field(default_factory=lambda: random.Random(5))
    best: float = 1.0

    def run(self, seconds: float, *, moving: float = 1.0) -> "Network":
        """`moving` is the share of its layer's rate that a frame needs: a still one little."""
        for n in range(round(seconds / STEP)):
            self.now += STEP
            own = 0.0 if self.adapter.pauses(self.now) else moving * RATES[self.adapter.layer]
            sent = max(own, self.adapter.look(self.now)) + BESIDE
            self._carry(sent * STEP, own > 0.0)
            self.layers.append(self.adapter.layer)
            hiccup = self.busy_computer if n % 40 in {3, 7} else 0.0
            age = self.now - self.taken + hiccup
            self.best = min(self.best, age)
            if n % 4 == 3 or (n % 2 == 1 and age > self.best + HURRY):
                self.adapter.aged(self.now, age, own or RATES[self.adapter.layer])
            if n % 20 == 19:
                self.adapter.lost(self.now, max(self.loss, self.lost))
        return self

    def _carry(self, bits: float, shows: bool) -> None:
        waiting = sum(held for held, _ in self.queue)
        taken = max(0.0, min(bits, 0.5 * self.capacity + self.capacity * STEP - waiting))
        self.lost = 0.8 * self.lost + 0.2 * (bits - taken) / bits
        # A picture of which a part is lost is not shown.
        whole = shows and taken == bits
        picture = self.now - self.rng.uniform(0.03, 0.09) if whole else float("-inf")
        self.queue.append((taken, picture))
        room = self.capacity * STEP
        while self.queue and self.queue[0][0] <= room:
            left, picture = self.queue.popleft()
            room, self.taken = room - left, max(self.taken, picture)
        if self.queue:
            self.queue[0] = (self.queue[0][0] - room, self.queue[0][1])
        self.delays.append(sum(held for held, _ in self.queue) / self.capacity)


def test_a_wide_network_keeps_the_best_layer():
    for moving in (1.0, 0.05):
        assert set(Network(5e6).run(60.0, moving=moving).layers) == {0}


def test_an_occasional_late_picture_keeps_the_layer():
    assert set(Network(5e6, busy_computer=0.2).run(30.0).layers) == {0}


def test_short_hang_of_a_computer_costs_at_most_two_layers_for_a_while():
    network = Network(5e6).run(5.0)
    for n in range(6):
        network.adapter.aged(network.now + 0.1 * n, 0.06 + 0.1 * n, RATES[0])
    assert network.adapter.layer <= 2
    network.now += 0.6
    assert network.run(8.0).adapter.layer == 0


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
    network.loss = 0.15
    assert network.run(4.0).adapter.layer > 0


def test_failed_trials_delay_no_picture_and_become_rarer():
    network = Network(5e6).run(2.0)
    network.capacity = 3.2e5
    network.run(15.0)
    before, network.delays = network.adapter.probes, []
    network.run(60.0)
    assert max(network.delays) < 0.35
    assert 5 <= network.adapter.probes - before <= 20


def test_hidden_page_does_not_count_as_a_narrow_network():
    network = Network(5e6).run(5.0)
    for n in range(100):
        network.adapter.aged(network.now + 0.2 * n, 0.05 + 0.2 * n, 1e6)
    assert network.adapter.layer < len(RATES) - 1, "what the first second looked like"
    network.now += 20.0
    network.layers = []
    assert network.run(10.0).adapter.layer == 0


def test_no_trial_runs_while_the_picture_is_stuck():
    network = Network(5e6).run(2.0)
    network.capacity = 4e5
    network.run(3.0)
    layer, probes = network.adapter.layer, network.adapter.probes
    for n in range(100):
        network.adapter.aged(network.now + 0.2 * n, 0.3 + 0.2 * n, 2e5)
        network.adapter.look(network.now + 0.2 * n)
    assert network.adapter.layer >= layer
    assert network.adapter.probes <= probes + 1


def test_the_layer_does_not_change_without_reports_of_the_page():
    adapter = BitrateAdapter(RATES, 0.0)
    assert all(adapter.look(0.1 * step) == 0.0 for step in range(600))
    assert adapter.layer == 0


def test_single_layer_never_changes():
    adapter = BitrateAdapter((0,), 0.0)
    for n in range(10):
        adapter.aged(0.2 * n, 0.1 * n, 1e6)
        adapter.lost(0.2 * n, 0.5)
    assert adapter.layer == 0
    assert adapter.look(60.0) == 0.0
