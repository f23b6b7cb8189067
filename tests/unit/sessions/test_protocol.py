"""The words of the WebSocket beside the Robot API."""

import typing
from pathlib import Path

import msgspec
import pytest

from robots.api import codec, topics
from robots.api.errors import Rejection
from sessions import protocol
from sessions.models import Session
from tests.support.paths import ROOT

CODES = [protocol.SIGNED_OUT, protocol.NOT_ALLOWED, protocol.NO_SUCH_ROBOT]
CODES += [protocol.FLOODED, protocol.TOO_SLOW, protocol.REPLACED]


def test_no_suffix_of_the_page_is_one_of_the_robot_api():
    # `signal/reply` looks like the signal of a peer called reply, but the server gives peers random
    # names.
    ours = {*protocol.TO_SERVER, *protocol.TO_PAGE, protocol.SIGNAL} - {"signal/reply"}
    assert all(topics.find(suffix) is None for suffix in ours)


def test_the_reference_names_every_suffix_and_close_code_that_a_program_may_meet():
    section = (
        Path(ROOT / "docs/reference/robot-api.md")
        .read_text(encoding="utf-8")
        .partition("## A program that drives")[2]
        .partition("## Topics")[0]
    )
    table = "".join(line for line in section.splitlines() if line.startswith("|"))
    of_pages = {*protocol.TO_PAGE, *protocol.TO_SERVER, protocol.SIGNAL}
    assert [suffix for suffix in of_pages if f"`{suffix}`" not in table] == []
    of_robots = {*topics.FROM_PAGE, *topics.TO_PAGE} - {"media"}
    assert [suffix for suffix in of_robots if f"`{suffix}`" not in section] == []
    assert [code for code in CODES if str(code) not in section] == []
    words = [
        typing.get_args(typing.get_type_hints(protocol.Fault)[name]) for name in ("part", "then")
    ]
    assert [word for kind in words for word in kind if f"`{word}`" not in section] == []


def test_a_page_report_keeps_the_pages_own_words():
    network = codec.encode(protocol.PageNetwork(stamp=1.0, way="mqtt", loss=0.1))
    report = protocol.PageReport(suffix="page/network", session="s1", message=msgspec.Raw(network))
    back = msgspec.json.decode(codec.encode(report), type=protocol.PageReport)
    assert (back.session, bytes(back.message)) == ("s1", network)
    assert protocol.page_reports("s1") == "telepresence/v1/server/page/s1"


@pytest.mark.parametrize(
    ("suffix", "payload"),
    [
        ("session/take", '{"session":"a b"}'),
        ("page/event", "{}"),
        ("signal", '{"type":"stay"}'),
    ],
)
def test_frames_of_other_shapes_are_malformed(suffix, payload):
    with pytest.raises(Rejection) as rejected:
        protocol.decode(suffix, payload)
    assert rejected.value.reason == "malformed"


def test_every_outcome_fits_into_its_message():
    for outcome in Session.Outcome.values:
        assert msgspec.convert({"session": "s", "outcome": outcome}, protocol.Ended)


def test_close_codes_differ_and_are_for_applications():
    assert len(set(CODES)) == len(CODES)
    assert all(4000 <= code < 5000 for code in CODES)
