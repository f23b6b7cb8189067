import pytest
from hypothesis import given, strategies as st

from robots.api.messages import NetworkLab
from robots.api.network_words import parse, spell
from tests.support.examples import examples


def test_words_are_milliseconds_percent_and_kbit_a_second():
    assert parse("delay=150, jitter=30,loss=2,reorder=1,rate=400", seed=7) == NetworkLab(
        delay=0.15, jitter=0.03, loss=0.02, reorder=0.01, bitrate=400_000.0, seed=7
    )


@examples(50, thorough=1000)
@given(
    st.integers(0, 10_000),
    st.floats(0.0, 1.0),
    st.integers(0, 100),
    st.integers(0, 100),
    st.none() | st.integers(1, 100_000),
)
def test_a_spelled_network_is_parsed_to_the_same_network(delay, share, loss, reorder, rate):
    lab = NetworkLab(
        delay=delay / 1000,
        jitter=int(delay * share) / 1000,
        loss=loss / 100,
        reorder=reorder / 100,
        bitrate=None if rate is None else rate * 1000.0,
    )
    words = spell(lab)
    read = parse(words) if words else NetworkLab()
    assert spell(read) == words
    for name in ("delay", "jitter", "loss", "reorder", "bitrate"):
        assert (
            getattr(read, name) == pytest.approx(getattr(lab, name)) or getattr(lab, name) is None
        )


def test_a_clean_network_has_no_words():
    assert spell(None) == spell(NetworkLab(seed=3)) == ""


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("fast", "'fast' is not a network setting"),
        (
            "speed=3",
            (
                "is not a network setting: write delay=150,jitter=30,loss=2, using delay,"
                " jitter, loss, reorder, rate"
            ),
        ),
        ("delay=soon", "delay must be a number of milliseconds from 0 to 10000, not 'soon'"),
        ("delay=nan", "delay must be a number of milliseconds"),
        ("loss=101", "loss must be a number of percent from 0 to 100, not '101'"),
        ("rate=0", "rate must be a number of kbit/s from 1 to 1000000, not '0'"),
        ("delay=1,delay=2", "delay is given twice"),
        ("delay=10,jitter=20", "jitter varies the delay"),
        ("", "'' is not a network setting"),
    ],
)
def test_bad_words_are_refused_with_one_sentence(words, said):
    with pytest.raises(ValueError, match=r".") as refusal:
        parse(words)
    assert said in str(refusal.value)
