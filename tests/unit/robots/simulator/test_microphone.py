"""What the robot hears."""

import numpy as np

from robots.simulator.microphone import BLOCK, Microphone


def sound(effort: float, blocks: int = 60) -> np.ndarray:
    microphone = Microphone(np.random.default_rng(1))
    return np.concatenate([microphone.block(effort) for _ in range(blocks)])


def test_a_block_is_twenty_milliseconds_of_int16() -> None:
    block = Microphone(np.random.default_rng(1)).block(0.0)
    assert block.shape == (BLOCK,)
    assert block.dtype == np.int16


def test_a_standing_robots_microphone_has_the_noise_of_a_quiet_room() -> None:
    assert 30 < sound(0.0).std() < 200


def test_the_motors_are_louder_and_higher_the_faster_the_wheels_turn() -> None:
    def pitch(samples: np.ndarray) -> float:
        tail = samples[-24000:].astype(float)
        spectrum = np.abs(np.fft.rfft(tail))
        return float(np.fft.rfftfreq(len(tail), 1 / 48000)[np.argmax(spectrum)])

    slow, fast = sound(0.3), sound(1.0)
    assert fast.std() > slow.std() > 2 * sound(0.0).std()
    assert pitch(fast) > pitch(slow) > 50


def test_there_is_no_click_between_blocks() -> None:
    steps = np.abs(np.diff(sound(0.8).astype(float)))
    seams = steps[BLOCK - 1 :: BLOCK]
    assert seams.max() <= steps.max()
    assert seams.mean() < 2.0 * steps.mean()


def test_the_same_seed_sounds_the_same() -> None:
    assert np.array_equal(sound(0.5, 5), sound(0.5, 5))
