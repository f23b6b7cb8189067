"""Topics and filters of MQTT 3.1.1, section 4.7."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.broker.filters import MAX_LENGTH, covers, is_filter, is_topic, matches

LEVEL = st.sampled_from(["a", "b", "", "c"])
TOPIC = st.lists(LEVEL, min_size=1, max_size=4).map("/".join).filter(bool)


@st.composite
def filters(draw):
    levels = draw(st.lists(st.sampled_from(["a", "b", "", "+"]), min_size=1, max_size=4))
    return "/".join([*levels, "#"] if draw(st.booleans()) else levels) or "#"


@pytest.mark.parametrize(
    ("filter_", "topic", "expected"),
    [
        ("a/b", "a/b", True),
        ("a/b", "a/c", False),
        ("a/+", "a/b", True),
        ("a/+", "a", False),
        ("a/+", "a/b/c", False),
        ("a/+", "a/", True),
        ("a/#", "a", True),
        ("a/#", "a/b/c", True),
        ("a/#", "ab", False),
        ("#", "a/b", True),
        ("+/b", "a/b", True),
        ("+/+", "/a", True),
        ("+", "/a", False),
        ("#", "$SYS/x", False),
        ("+/x", "$SYS/x", False),
        ("$SYS/#", "$SYS/x", True),
        ("a", "a/", False),
    ],
)
def test_a_filter_matches_as_the_standard_says(filter_, topic, expected):
    assert matches(filter_, topic) is expected


@pytest.mark.parametrize("good", ["a", "a/b", "+", "#", "a/+/b", "a/#", "/", "+/#", "$SYS/#"])
def test_well_formed_filters_are_filters(good):
    assert is_filter(good)


@pytest.mark.parametrize(
    "bad", ["", "a#", "#/a", "a/#/b", "a+", "a/b+/c", "a\0", "a" * (MAX_LENGTH + 1), "/" * 40]
)
def test_malformed_filters_are_none(bad):
    assert not is_filter(bad)


@pytest.mark.parametrize("bad", ["", "#", "a/+", "a\0", "a" * (MAX_LENGTH + 1), "/" * 40])
def test_what_holds_wildcards_or_is_endless_is_no_topic(bad):
    assert not is_topic(bad)


@given(filters(), filters(), TOPIC)
def test_what_a_permission_covers_it_matches_too(permission, filter_, topic):
    if covers(permission, filter_) and matches(filter_, topic):
        assert matches(permission, topic)


@given(filters(), st.data())
def test_a_permission_that_does_not_cover_a_filter_leaves_out_a_topic_of_it(permission, data):
    filter_ = data.draw(filters())
    if not covers(permission, filter_):
        witness = [
            filter_.replace("+", word).replace("#", tail)
            for word in ("z", "a", "b", "")
            for tail in ("y/y/y/y/y", "a", "")
        ]
        witness += [filter_.removesuffix("/#").replace("+", word) for word in ("z", "a", "b", "")]
        # The empty topic is none, but it alone tells "/#" from what is below it.
        assert any(
            matches(filter_, topic) and not matches(permission, topic)
            for topic in witness
            if is_topic(topic) or not topic
        )


@given(filters())
def test_every_filter_covers_itself_and_is_covered_by_everything(filter_):
    assert covers(filter_, filter_)
    assert covers("#", filter_)
