"""A viewer is never fed with holes."""

import pytest
from hypothesis import given, strategies as st

from robots.agent.media.codecs.encoder import Picture
from robots.agent.media.webrtc.sender_queue import DEPTH, MAX_BACKLOG, ViewerQueue
from tests.support.examples import examples


def _picture(number: int, *, key: bool = False) -> Picture:
    return Picture((b"x",), key, number, float(number))


@pytest.fixture
def queue() -> ViewerQueue:
    return ViewerQueue()


def test_a_full_socket_counts_as_behind_even_for_a_key_frame(queue: ViewerQueue) -> None:
    queue.put(_picture(0, key=True))
    assert queue.put(_picture(1), MAX_BACKLOG + 1)
    queue.put(_picture(2, key=True), MAX_BACKLOG + 1)
    assert len(queue) == 0
    queue.put(_picture(3, key=True), 0)
    assert queue.take().rtp == 3


def test_a_waiting_viewer_repeats_its_request_now_and_then(queue: ViewerQueue) -> None:
    assert [n for n in range(70) if queue.put(_picture(n))] == [29, 59]


@examples(50, thorough=1000)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["delta", "delta", "delta", "key", "take"]),
            st.sampled_from([0, 0, 0, MAX_BACKLOG + 1]),
        ),
        max_size=200,
    )
)
def test_taken_frames_have_no_gap(steps: list[tuple[str, int]]) -> None:
    queue, number, taken = ViewerQueue(), 0, []
    for what, backlog in steps:
        if what == "take":
            taken.append(queue.take())
        else:
            queue.put(_picture(number, key=what == "key"), backlog)
            number += 1
        assert len(queue) <= DEPTH
    pictures = [picture for picture in taken if picture is not None]
    last = None
    for picture in pictures:
        assert picture.key or picture.rtp == last + 1
        last = picture.rtp
