"""Which pictures a page is sent when its network changes."""

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


def test_scans_and_poses_are_sent_seldom_on_a_narrow_network(viewer):
    sent = []
    viewer.page = SimpleNamespace(send=sent.append)
    viewer._layer = 3
    for _ in range(5):
        for suffix in ("scan", "pose", "state", "event"):
            viewer.send(suffix, f"{suffix}\n{{}}")
    counts = {
        suffix: sent.count(f"{suffix}\n{{}}") for suffix in ("scan", "pose", "state", "event")
    }
    assert counts == {"scan": 1, "pose": 1, "state": 5, "event": 5}
