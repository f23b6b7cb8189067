"""Codings as files of ELAN and BORIS: round trips, other programs' readers, hostile files."""

import json
import warnings
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given, strategies as st
from pympi.Elan import Eaf

from experiments.coding.boris import from_boris, to_boris
from experiments.coding.eaf import from_eaf, to_eaf
from experiments.coding.scheme import (
    BadCodingError,
    CodedEvent,
    clean,
    events_from,
    scheme_from,
    scheme_in,
)
from experiments.definition.coding import Code, Modifier
from tests.support.examples import examples

ASKED = Modifier("asked whom", ("a visitor", "the robot"))
LOUD = Modifier("loudness", ("low", "high"))
CODES = (
    Code("help", "Asks for help", "point", "h", modifiers=(ASKED, LOUD)),
    Code("lost", "Seems lost", "interval", "l", group="way"),
    Code("found", "Knows the route", "interval", "f", group="way"),
    Code("talk", "Talks", "interval", modifiers=(LOUD,)),
)
EVENTS = [
    CodedEvent("lost", 0.0, 4.25, "at the door <1> & 2"),
    CodedEvent("help", 2.5, None, "", {"loudness": "low"}),
    CodedEvent("talk", 3.0, 6.001, "", {"loudness": "high"}),
    CodedEvent("lost", 4.25, 9.0, "again"),
    CodedEvent("help", 9.5, None, "calls"),
]
DATE = "2026-03-04T12:00:00+00:00"


@pytest.fixture
def eaf(tmp_path):
    path = tmp_path / "coding.eaf"
    path.write_bytes(to_eaf(CODES, EVENTS, "C2345", DATE))
    return path


def test_another_program_reads_the_tiers_and_annotations(eaf):
    # pympi is a reader and writer of ELAN files that others maintain; it warns of FORMAT 3.0.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        read = Eaf(str(eaf), suppress_version_warning=True)
    assert sorted(read.get_tier_names()) == [
        *("found", "help", "help@asked whom", "help@loudness", "lost", "talk", "talk@loudness")
    ]
    assert read.get_ref_annotation_data_for_tier("talk@loudness") == [(3000, 6001, "high", "")]
    assert sorted(read.get_annotation_data_for_tier("lost")) == [
        (0, 4250, "at the door <1> & 2"),
        (4250, 9000, "again"),
    ]
    assert min(read.get_annotation_data_for_tier("help"))[:2] == (2500, 2501)
    assert read.adocument["FORMAT"] == "3.0"


def test_files_of_another_program_are_read(tmp_path):
    other = Eaf()
    other.add_tier("lost")
    other.add_annotation("lost", 1000, 2500, "here")
    other.add_tier("Asks for help")
    other.add_annotation("Asks for help", 3000, 3001)
    other.add_tier("gaze")
    other.add_annotation("gaze", 0, 10)
    path = tmp_path / "other.eaf"
    other.to_file(str(path))
    events, problems = from_eaf(path.read_bytes(), CODES)
    assert sorted(events, key=lambda event: event.begin) == [
        CodedEvent("lost", 1.0, 2.5, "here"),
        CodedEvent("help", 3.0),
    ]
    assert any("gaze" in problem for problem in problems)


seconds = st.integers(0, 3_600_000).map(lambda ms: ms / 1000)
comments = st.text(st.characters(categories=("L", "N", "P", "S")), max_size=20)
loud = st.sampled_from([{}, {"loudness": "low"}, {"loudness": "high"}])
asked = st.sampled_from([{}, {"asked whom": "the robot"}])


@st.composite
def codings(draw) -> list[CodedEvent]:
    points = [
        CodedEvent("help", at, None, draw(comments), draw(loud) | draw(asked))
        for at in draw(st.lists(seconds, max_size=5, unique=True))
    ]
    times = sorted(draw(st.lists(seconds, max_size=8, unique=True)))
    pairs = zip(times[::2], times[1::2], strict=False)
    intervals = [
        CodedEvent(draw(st.sampled_from(["lost", "found"])), begin, end, draw(comments))
        for begin, end in pairs
    ]
    talks = [CodedEvent("talk", 1.0, 2.5, "", draw(loud))]
    document = [
        {
            "code": one.code,
            "begin": one.begin,
            "end": one.end,
            "comment": clean(one.comment),
            "modifiers": one.modifiers,
        }
        for one in (*points, *intervals, *talks)
    ]
    return events_from(document, CODES, 3600.0)


def in_order(events: list[CodedEvent]) -> list:
    return sorted(
        (one.code, one.begin, one.end or 0.0, one.comment, sorted(one.modifiers.items()))
        for one in events
    )


@examples(30, thorough=300)
@given(codings())
def test_coding_is_read_unchanged_from_an_elan_file(events):
    read, problems = from_eaf(to_eaf(CODES, events, "C2345", DATE), CODES)
    assert in_order(read) == in_order(events)
    assert problems == []


@examples(30, thorough=300)
@given(codings())
def test_coding_is_read_unchanged_from_a_boris_project(events):
    document = to_boris(CODES, {"S1": events, "S2": []}, "study", "2026-03-04T12:00:00")
    read, problems = from_boris(document, CODES, "S1")
    assert in_order(read) == in_order(events)
    assert problems == []


def test_a_boris_project_has_the_parts_that_boris_opens():
    project = json.loads(to_boris(CODES, {"S1": EVENTS}, "study", "2026-03-04T12:00:00"))
    # boris/config.py, EMPTY_PROJECT
    assert project.keys() >= {
        *("time_format", "project_date", "project_name", "project_description"),
        *("project_format_version", "subjects_conf", "behaviors_conf", "observations"),
        *("behavioral_categories", "behavioral_categories_config", "independent_variables"),
        *("coding_map", "behaviors_coding_map", "converters"),
    }
    # boris/config.py, behavioursFields
    assert project["behaviors_conf"]["1"].keys() == {
        *("type", "key", "code", "description", "color", "category", "modifiers", "excluded"),
        "coding map",
    }
    assert project["behaviors_conf"]["1"]["type"] == "State event"
    # boris/otx_parser.py: the codes that end this one, with commas; boris/add_modifier.py
    assert project["behaviors_conf"]["1"]["excluded"] == "found"
    assert project["behaviors_conf"]["0"]["modifiers"]["1"] == {
        "name": "loudness",
        "description": "",
        "type": 0,
        "ask at stop": False,
        "values": ["low", "high"],
    }
    rows = project["observations"]["S1"]["events"]
    assert rows[1] == [2.5, "", "help", "None|low", ""]
    lost = [row[0] for row in project["observations"]["S1"]["events"] if row[2] == "lost"]
    assert lost == [0.0, 4.25, 4.25, 9.0]


def test_an_observation_is_named_where_there_are_several():
    document = to_boris(CODES, {"S1": [], "S2": []}, "study", "2026-03-04T12:00:00")
    with pytest.raises(BadCodingError, match="S1, S2"):
        from_boris(document, CODES)
    with pytest.raises(BadCodingError, match="S1, S2"):
        from_boris(document, CODES, "S3")


def test_parts_of_a_boris_project_that_are_not_imported_are_listed():
    rows = [[1, "ann", "help", "", ""], [2, "", "gaze", "", ""], [3, "", "lost", "", ""], ["x"]]
    rows.append([4, "", "help", "a dog|low|x", ""])
    more = {"time offset": 2.5, "file": {"1": ["a.mp4"]}, "description": "d"}
    project = {"observations": {"one": {"type": "MEDIA", "events": rows, **more}}}
    events, problems = from_boris(json.dumps(project).encode(), CODES)
    assert events == [
        CodedEvent("help", 1.0),
        CodedEvent("help", 4.0, None, "", {"loudness": "low"}),
    ]
    sentences = " ".join(problems)
    message = ("Subjects", "gaze", "never stops", "not an event", "“a dog”", "“x”")
    assert all(
        part in sentences for part in (*message, "offset of 2.5 s", "media files", "description")
    )


def test_parts_of_an_elan_file_that_are_not_imported_are_listed():
    file = to_eaf(CODES, EVENTS, "C1", DATE).decode()
    file = file.replace(">high<", ">shouting<").replace('TIER_ID="found"', 'TIER_ID="gaze"')
    media = '<MEDIA_DESCRIPTOR MEDIA_URL="file:///a/drive.mp4" MIME_TYPE="video/mp4" />'
    file = file.replace('<PROPERTY NAME="last', f'{media}<PROPERTY NAME="last')
    events, problems = from_eaf(file.encode(), CODES)
    assert len(events) == len(EVENTS)
    sentences = " ".join(problems)
    assert all(part in sentences for part in ("gaze", "“shouting”", "drive.mp4"))


def test_elements_are_in_the_order_of_the_schema():
    root = ET.fromstring(to_eaf(CODES, EVENTS, "C1", DATE))
    # EAFv3.0.xsd: ANNOTATION_DOCUMENT is a sequence, and ids are unique
    order = ["HEADER", "TIME_ORDER", "TIER", "LINGUISTIC_TYPE", "CONSTRAINT"]
    assert list(dict.fromkeys(child.tag for child in root)) == order
    ids = [one.get("ANNOTATION_ID") for one in root.iter() if one.get("ANNOTATION_ID")]
    assert len(ids) == len(set(ids)) == 7
    types = {one.get("LINGUISTIC_TYPE_ID") for one in root.iter("LINGUISTIC_TYPE")}
    assert {tier.get("LINGUISTIC_TYPE_REF") for tier in root.iter("TIER")} <= types


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (b'<!DOCTYPE a [<!ENTITY b "c">]><ANNOTATION_DOCUMENT/>', "document type"),
        (b"<a>", "not valid XML"),
        (b"<a/>", "not an ELAN"),
    ],
)
def test_a_file_that_is_no_elan_file_is_refused(document, message):
    with pytest.raises(BadCodingError, match=message):
        from_eaf(document, CODES)


@pytest.mark.parametrize(
    ("document", "message"),
    [(b"[", "not valid JSON"), (b"[]", "not a BORIS"), (b'{"observations": {}}', "not a BORIS")],
)
def test_a_file_that_is_no_boris_project_is_refused(document, message):
    with pytest.raises(BadCodingError, match=message):
        from_boris(document, CODES)


# --- schemes and codings --------------------------------------------------------------------------


def code(**more) -> dict:
    return {"code": "a", "name": "A", "kind": "point", "key": "a"} | more


@pytest.mark.parametrize(
    ("codes", "message"),
    [
        ([code(), code(key="b")], "Code “a” appears 2 times"),
        ([code(), code(code="b", key="A")], "Key “a” appears 2 times"),
        ([code(key="k")], "choose a single character"),
        ([code(key="ab")], "choose a single character"),
        ([], "no codes"),
        ([code(group="g")], "no duration"),
        ([code(modifiers=[{"name": "m", "values": []}])], "needs 1 to"),
        ([code(modifiers=[{"name": "m", "values": ["a|b"]}])], "cannot be used"),
        ([code(modifiers=[{"name": "m", "values": ["None"]}])], "cannot be used"),
        ([code(name=" ")], "enter a name"),
        ([code(code="A b")], "regex"),
        ([code(kind="x")], "enum|Invalid"),
        ([code(code=f"c{n}", key="") for n in range(41)], "at most 40"),
    ],
)
def test_a_scheme_that_cannot_be_used_is_refused(codes, message):
    with pytest.raises(BadCodingError, match=message):
        scheme_from(codes)


@pytest.mark.parametrize(
    ("event", "message"),
    [
        ({"code": "x", "begin": 1}, "no code"),
        ({"code": "help", "begin": 1, "end": 2}, "can't have an end"),
        ({"code": "lost", "begin": 1}, "must end after"),
        ({"code": "lost", "begin": 2, "end": 2}, "must end after"),
        ({"code": "help", "begin": -1}, "outside"),
        ({"code": "help", "begin": 61}, "outside"),
        ({"code": "help", "begin": 1, "comment": "x" * 501}, "too long"),
        ({"code": "help"}, "begin"),
    ],
)
def test_an_event_that_does_not_fit_is_refused(event, message):
    with pytest.raises(BadCodingError, match=message):
        events_from([event], CODES, 60.0)


def test_a_scheme_of_a_file_may_be_a_list_of_codes_or_have_more():
    assert scheme_in(json.dumps([code()]).encode()).blind is False
    whole = {"codes": [code()], "blind": True, "bin": 0.5, "tolerance": 1}
    assert scheme_in(json.dumps(whole).encode()).bin == 0.5
    with pytest.raises(BadCodingError, match="not valid JSON"):
        scheme_in(b"{")
    with pytest.raises(BadCodingError, match="too large"):
        scheme_in(b" " * 300_000)


def test_overlapping_states_of_a_group_and_repeated_points_are_refused():
    states = [{"code": "lost", "begin": 1, "end": 4}, {"code": "found", "begin": 3, "end": 5}]
    with pytest.raises(BadCodingError, match=r"found at 3\.000 s begins before"):
        events_from(states, CODES, 60.0)
    with pytest.raises(BadCodingError, match="appears twice"):
        events_from([{"code": "help", "begin": 1}] * 2, CODES, 60.0)


def test_intervals_of_one_code_do_not_overlap():
    events = [
        {"code": "lost", "begin": 1, "end": 4},
        {"code": "talk", "begin": 2, "end": 3},
        {"code": "lost", "begin": 3, "end": 5},
    ]
    with pytest.raises(BadCodingError, match=r"lost at 3\.000 s begins before"):
        events_from(events, CODES, 60.0)
