"""A photo in two halves."""

import hashlib

from robots.api.messages import Event
from sessions.recording.photos import MAX_WAITING, PAIR_TIMEOUT_S, Photos


def event(action: str, jpeg: bytes) -> Event:
    digest = hashlib.sha256(jpeg).hexdigest()
    return Event(stamp=1.0, boot="b", seq=1, type="photo", action_id=action, sha256=digest)


def test_the_halves_meet_in_either_order():
    photos = Photos()
    assert photos.event("r", event("a", b"1"), 0.0) is None
    assert photos.jpeg("r", "a", b"1", 0.0).intact
    assert photos.jpeg("r", "b", b"2", 0.0) is None
    assert photos.event("r", event("b", b"2"), 0.0).jpeg == b"2"


def test_bytes_that_changed_on_the_way_are_not_intact():
    photos = Photos()
    photos.event("r", event("a", b"1"), 0.0)
    assert not photos.jpeg("r", "a", b"2", 0.0).intact


def test_robots_do_not_get_each_others_photos():
    photos = Photos()
    photos.event("r", event("a", b"1"), 0.0)
    assert photos.jpeg("other", "a", b"1", 0.0) is None


def test_halves_that_wait_too_long_or_are_too_many_are_dropped():
    photos = Photos()
    for number in range(MAX_WAITING + 3):
        photos.jpeg("r", f"a{number}", b"1", float(number) / 100)
    assert photos.forgotten(1.0) == [("r", "a0"), ("r", "a1"), ("r", "a2")]
    assert len(photos.forgotten(PAIR_TIMEOUT_S + 10.0)) == MAX_WAITING
