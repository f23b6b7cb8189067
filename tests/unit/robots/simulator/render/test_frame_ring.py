"""Pictures in shared memory."""

import numpy as np
import pytest

from robots.simulator.render.frame_ring import FrameReader, FrameWriter
from tests.support.agents.simulators import memory_exists


@pytest.fixture
def ring():
    writer = FrameWriter(32, 24, slots=3)
    reader = FrameReader(writer.name, 32, 24, 3)
    yield writer, reader
    reader.close()
    writer.close()


def put(writer: FrameWriter, value: int) -> int:
    writer.begin()[:] = value
    return writer.commit()


def test_a_picture_arrives_as_it_was_drawn(ring) -> None:
    writer, reader = ring
    picture = np.random.default_rng(2).integers(0, 256, (36, 32), dtype=np.uint8)
    writer.begin()[:] = picture
    assert np.array_equal(reader.copy(writer.commit()), picture)


def test_a_picture_that_was_overtaken_is_not_given_out(ring) -> None:
    writer, reader = ring
    first = put(writer, 1)
    for value in range(2, 5):
        put(writer, value)
    assert reader.copy(first) is None


def test_a_picture_in_the_making_is_not_given_out(ring) -> None:
    writer, reader = ring
    old = put(writer, 1)
    put(writer, 2)
    put(writer, 3)
    writer.begin()[:18] = 9  # half drawn over the first
    assert reader.copy(old) is None
    assert reader.copy(writer.number) is None
    assert (reader.copy(writer.commit())[:18] == 9).all()


def test_a_copy_does_not_change_with_later_writes(ring) -> None:
    writer, reader = ring
    copy = reader.copy(put(writer, 7))
    for value in range(5):
        put(writer, value)
    assert (copy == 7).all()


def test_the_memory_is_removed_with_the_writer_and_not_with_a_reader(ring) -> None:
    writer, reader = ring
    name = writer.name
    reader.close()
    assert memory_exists(name)
    writer.close()
    assert not memory_exists(name)
    writer.close()


def test_reader_of_missing_memory_raises() -> None:
    with pytest.raises(OSError):
        FrameReader("telepresence-nothing-here", 32, 24, 3)
