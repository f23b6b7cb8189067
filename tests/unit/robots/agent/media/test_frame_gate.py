"""How much a page may say."""

from robots.agent.media.frame_gate import BURST, MAX_BYTES, RATE, FrameGate


def test_a_driving_page_passes() -> None:
    gate = FrameGate(0.0)
    assert all(gate.judge("command/velocity\n{}", n / 50) == "accepted" for n in range(1000))


def test_a_flood_is_cut_to_the_rate() -> None:
    gate = FrameGate(0.0)
    verdicts = [gate.judge(b"x", n / 10_000) for n in range(20_000)]
    assert BURST + 2 * RATE - 2 <= verdicts.count("accepted") <= BURST + 2 * RATE + 2
    assert gate.counts["too_fast"] == verdicts.count("too_fast")


def test_an_oversized_frame_is_dropped_whatever_it_says() -> None:
    gate = FrameGate(0.0)
    assert gate.judge("stop" * MAX_BYTES, 0.0) == "oversized"
    assert gate.judge(b"x" * (MAX_BYTES + 1), 0.0) == "oversized"


def test_a_stop_passes_in_the_middle_of_a_flood() -> None:
    gate = FrameGate(0.0)
    for _ in range(1000):
        gate.judge("x", 0.0)
    assert gate.judge('command/action\n{"type":"estop"}', 0.0) == "accepted"
    assert gate.judge(b'command/action\n{"type":"stop"}', 0.0) == "accepted"
    assert gate.judge("x", 0.0) == "too_fast"
