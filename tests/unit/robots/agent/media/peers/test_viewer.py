"""Which pictures a page is sent when its network changes."""

import math
from collections import Counter
from types import SimpleNamespace

import pytest

from robots.agent.media.codecs.encoder import Picture
from robots.agent.media.peers.viewer import Viewer


class Camera:
    rates = (1_000_000, 500_000)

    def __init__(self):
        self.asked = []

    def watch(self, number, layer=0):
        pass

    def ask_key_frame(self, reason, layer=0):
        self.asked.append(layer)


@pytest.fixture
def viewer():
    """A viewer with doubles of adapter and queue: `sent` has layer and RTP time of its pictures."""
    made = Viewer(
        "p",
        camera=Camera(),
        microphone=None,
        on_command=lambda packet: None,
        on_end=lambda reason: None,
    )
    made._watching = True
    made.sent = []
    made._adapter = SimpleNamespace(
        layer=0, paused=False, pauses=lambda now: made._adapter.paused, look=lambda now: 0.0
    )
    made._pictures = SimpleNamespace(
        more=0.0, put=lambda picture: made.sent.append((picture.layer, picture.rtp))
    )
    return made


def show(viewer, rtp, *, layer=0, key=False):
    viewer.show(Picture((b"x",), key, rtp, rtp / 90_000, layer))


def test_after_a_pause_pictures_continue_with_a_key_frame_that_is_requested_once(viewer):
    show(viewer, 1, key=True)
    viewer._adapter.paused = True
    for rtp in (2, 3):
        show(viewer, rtp)
    viewer._adapter.paused = False
    for rtp in (4, 5):
        show(viewer, rtp)
    assert viewer._camera.asked == [0]
    show(viewer, 6, key=True)
    show(viewer, 7)
    assert viewer.sent == [(0, 1), (0, 6), (0, 7)]


def test_pause_before_a_lower_layer_ends_with_that_layer(viewer):
    show(viewer, 1, key=True)
    viewer._adapter.layer, viewer._adapter.paused = 1, True
    viewer._move()
    show(viewer, 2, layer=1, key=True)  # comes too early
    viewer._adapter.paused = False
    show(viewer, 3)
    show(viewer, 3, layer=1)
    assert viewer._camera.asked == [1, 1], "with the step, and after the pause"
    show(viewer, 4, key=True)  # of the old layer
    show(viewer, 5, layer=1, key=True)
    show(viewer, 6, layer=1)
    assert viewer.sent == [(0, 1), (1, 5), (1, 6)]


@pytest.mark.parametrize(("rate", "states"), [(300_000, 5), (50_000, 1)])
def test_a_narrow_network_gets_few_scans_and_poses_and_a_very_narrow_one_few_states(
    viewer, rate, states
):
    sent = []
    viewer.page = SimpleNamespace(send=sent.append)
    viewer._leave_room_for(rate)
    for _ in range(5):
        for suffix in ("scan", "pose", "state", "event"):
            viewer.send(suffix, suffix)
    counts = {suffix: sent.count(suffix) for suffix in ("scan", "pose", "state", "event")}
    assert counts == {"scan": 1, "pose": 1, "state": states, "event": 5}


def test_listener_on_a_narrow_network_gets_the_sound_for_it_and_all_forwarded_sound(viewer):
    heard, listeners = [], Counter()
    viewer._sounds = SimpleNamespace(put=lambda payload, ticks: heard.append(payload))
    viewer._microphone = SimpleNamespace(
        listen=lambda number, *, narrow: listeners.update({narrow: number})
    )
    viewer._watching = False
    viewer._watch(watching=True)
    for rate in (math.inf, 80_000):
        viewer._leave_room_for(rate)
        for narrow in (False, True, None):
            viewer.sound(f"{rate} {narrow}", 0, narrow)
    assert heard == ["inf False", "inf None", "80000 True", "80000 None"]
    assert listeners == {False: 0, True: 1}


def test_new_connection_of_a_page_begins_with_the_layer_of_the_last_one(viewer):
    viewer.resume(1)
    show(viewer, 1, key=True)
    show(viewer, 2, layer=1, key=True)
    viewer.resume(2)
    show(viewer, 3, layer=1)
    assert viewer.sent == [(1, 2), (1, 3)], "a layer that the camera does not have is ignored"
