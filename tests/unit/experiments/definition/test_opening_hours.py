import datetime
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given, strategies as st

from experiments.definition.opening_hours import is_open, opens_at, problems
from tests.support.examples import examples

MADRID = "Europe/Madrid"
OFFICE = [{"days": [0, 1, 2, 3, 4], "start": "09:00", "end": "17:00"}]
NIGHT = [{"days": [4], "start": "22:00", "end": "02:00"}]


def at(text: str, zone: str = MADRID) -> datetime.datetime:
    return datetime.datetime.fromisoformat(text).replace(tzinfo=ZoneInfo(zone))


def test_without_hours_a_study_is_always_open():
    assert is_open([], "UTC", at("2026-03-07 03:00"))
    assert opens_at([], "UTC", at("2026-03-07 03:00")) is None


@pytest.mark.parametrize(
    ("when", "open_"),
    [
        ("2026-03-06 08:59", False),
        ("2026-03-06 09:00", True),
        ("2026-03-06 16:59", True),
        ("2026-03-06 17:00", False),
        ("2026-03-07 12:00", False),
    ],
)
def test_a_span_holds_from_its_start_to_just_before_its_end_on_its_days(when, open_):
    assert is_open(OFFICE, MADRID, at(when)) is open_


def test_the_study_s_zone_decides_not_the_visitor_s():
    assert is_open(OFFICE, MADRID, at("2026-03-06 08:30", "UTC"))
    assert not is_open(OFFICE, MADRID, at("2026-03-06 16:30", "UTC"))


def test_a_closed_study_has_the_time_when_it_opens_next():
    assert opens_at(OFFICE, MADRID, at("2026-03-06 18:00")) == at("2026-03-09 09:00")
    assert opens_at(OFFICE, MADRID, at("2026-03-06 08:00")) == at("2026-03-06 09:00")
    assert opens_at(OFFICE, MADRID, at("2026-03-06 12:00")) is None


def test_a_span_may_pass_midnight_and_fill_whole_days():
    assert is_open(NIGHT, MADRID, at("2026-03-07 01:59"))
    assert not is_open(NIGHT, MADRID, at("2026-03-07 02:00"))
    always = [{"days": list(range(7)), "start": "00:00", "end": "00:00"}]
    assert is_open(always, MADRID, at("2026-03-29 02:30"))


def test_nine_o_clock_stays_nine_o_clock_when_the_clocks_change():
    daily = [{"days": list(range(7)), "start": "09:00", "end": "10:00"}]
    assert opens_at(daily, MADRID, at("2026-03-28 11:00")) == at("2026-03-29 09:00")
    # by the wall
    assert at("2026-03-29 09:00") - at("2026-03-28 09:00") == datetime.timedelta(days=1)
    assert is_open(daily, MADRID, datetime.datetime(2026, 3, 29, 7, 30, tzinfo=datetime.UTC))
    assert is_open(daily, MADRID, datetime.datetime(2026, 3, 28, 8, 30, tzinfo=datetime.UTC))


@examples(50, thorough=1000)
@given(
    st.lists(
        st.builds(
            lambda days, start, end: {
                "days": sorted(days),
                "start": f"{start:02d}:00",
                "end": f"{end:02d}:30",
            },
            st.sets(st.integers(0, 6), min_size=1),
            st.integers(0, 23),
            st.integers(0, 23),
        ),
        min_size=1,
        max_size=4,
    ),
    st.sampled_from(["UTC", MADRID, "America/New_York", "Australia/Lord_Howe"]),
    st.integers(1_767_225_600, 1_798_761_600),  # the year 2026
)
def test_study_opens_at_the_announced_time_and_not_before(hours, zone, moment):
    now = datetime.datetime.fromtimestamp(moment, datetime.UTC)
    assert list(problems(hours, zone)) == []
    opens = opens_at(hours, zone, now)
    assert (opens is None) == is_open(hours, zone, now)
    if opens is not None:
        assert opens > now
        assert is_open(hours, zone, opens)
        assert not is_open(hours, zone, opens - datetime.timedelta(seconds=1))


@pytest.mark.parametrize(
    ("hours", "zone"),
    [
        (OFFICE, "Mars/Olympus"),
        (OFFICE, ""),
        (OFFICE, "../etc"),
        ("always", "UTC"),
        ([{}], "UTC"),
        ([{"days": [], "start": "09:00", "end": "10:00"}], "UTC"),
        ([{"days": [7], "start": "09:00", "end": "10:00"}], "UTC"),
        ([{"days": [True], "start": "09:00", "end": "10:00"}], "UTC"),
        ([{"days": [1], "start": "9:00", "end": "10:00"}], "UTC"),
        ([{"days": [1], "start": "09:00", "end": "24:00"}], "UTC"),
        ([{"days": [1], "start": 9, "end": "10:00"}], "UTC"),
        (OFFICE * 51, "UTC"),
    ],
)
def test_impossible_hours_are_problems(hours, zone):
    assert list(problems(hours, zone))
