"""Every field of every kind of message and event has a form in the allow list."""

import ast
import inspect
import json
import re
from pathlib import Path
from typing import get_args

import msgspec
import pytest

from experiments.definition.coding import Code, CodingScheme, Modifier
from experiments.extraction import allow_list
from experiments.extraction.allow_list import (
    CODING_EDIT,
    EVENTS,
    KEPT_BACK,
    MESSAGES,
    coded,
    released,
)
from experiments.extraction.forms import Origin, Release, kept
from experiments.extraction.pseudonyms import Pseudonyms
from experiments.extraction.selection import Selection
from experiments.models import CodingEdit
from experiments.tasks.progress import EventType, ProgressEvent
from robots.api import messages
from sessions import protocol
from sessions.leases import transitions
from sessions.wizard import leases as wizard_leases
from tests.support.analysis.filled import Filler, as_stored, kinds
from tests.support.media.sources import python_files, text_of
from tests.support.paths import ROOT
from tests.support.studies.traces import Known, traces

DECIDE = (
    "decide in experiments/extraction/allow_list.toml what of it a pseudonymous dataset may "
    "contain: `withheld` (or kept_back for a whole kind) withholds it"
)
GRANTED = 1_777_885_200.25
RELEASE = Release(Pseudonyms("5e" * 32), Selection(), frozenset({"hall"}), frozenset({"hello"}))
PHOTO = "0b6c1a52-52f0-4d5c-9f3e-1f0f9d0c7a11"


def names(kind: type) -> set[str]:
    return {field.encode_name for field in msgspec.structs.fields(kind)}


def leaves(source: str, kind: str, data: dict, *, offset: float = 0.0, **choice) -> dict | None:
    release = Release(RELEASE.names, Selection(**choice), RELEASE.doors, RELEASE.steps)
    return released(source, kind, data, release, Origin(GRANTED, offset))


# --- every field is listed ------------------------------------------------------------------------


@pytest.mark.parametrize("kind", kinds(), ids=lambda kind: kind.__qualname__)
def test_every_kind_of_message_has_its_forms(kind):
    assert (kind in MESSAGES) != (kind in KEPT_BACK), f"{kind.__qualname__}: {DECIDE}"
    undecided = names(kind) - set(MESSAGES.get(kind, names(kind)))
    assert not undecided, f"{kind.__qualname__}.{sorted(undecided)}: {DECIDE}"


def test_every_listed_message_and_field_exists():
    for kind, listed in MESSAGES.items():
        assert set(listed) == names(kind), kind
    assert set(kinds()) >= KEPT_BACK


def test_every_type_of_a_robots_event_is_listed():
    types = {*get_args(messages.Event.__annotations__["type"]), "action"}
    missing, removed = types - set(EVENTS["robot"]), set(EVENTS["robot"]) - types
    assert not missing, f"event {sorted(missing)} of robots: {DECIDE}"
    assert not removed
    for kind in types - {"action"}:
        undecided = names(messages.Event) - set(EVENTS["robot"][kind])
        assert not undecided, f"{kind}.{sorted(undecided)}: {DECIDE}"


def test_every_event_of_a_task_is_listed_with_every_field():
    types = set(get_args(EventType))
    assert types == set(EVENTS["task"]), f"{sorted(types ^ set(EVENTS['task']))}: {DECIDE}"
    whole = set(inspect.signature(ProgressEvent).parameters) - {"at", "type"}
    stored = {"sight": "facing"}  # as ProgressEvent.data() calls it
    listed = {name for fields in EVENTS["task"].values() for name in fields}
    assert listed == {stored.get(name, name) for name in whole}, DECIDE


WRITES = re.compile(r"\b_(?:note|event_row)\(")


def written_by(*folders: str) -> set[str]:
    """Return the types of events that the server's code writes down with a word in place."""
    found = set()
    sources = (text_of(path) for folder in folders for path in python_files(folder))
    for source in filter(WRITES.search, sources):
        for node in ast.walk(ast.parse(source)):
            name = getattr(getattr(node, "func", None), "attr", getattr(node, "func", None))
            called = getattr(name, "id", name)
            at = {"_note": 1, "_event_row": 2}.get(called) if called else None
            if at is not None and len(node.args) > at:
                words = (one for one in ast.walk(node.args[at]) if isinstance(one, ast.Constant))
                found |= {one.value for one in words if isinstance(one.value, str)}
    return found


def test_every_event_that_the_server_records_is_listed():
    written = written_by("sessions", "experiments")
    assert {"first_motion", "staff_called", "states_missing", "operator_end"} <= written
    moved = {"connecting", "reconnecting", "driving"}
    assert moved <= set(get_args(transitions.State))
    recorded = {protocol.NOTICE_NAMES[kind] for kind in MESSAGES if kind in protocol.NOTICE_NAMES}
    undecided = (written - {"action"} | moved | recorded) - set(EVENTS["server"])
    assert not undecided, f"event {sorted(undecided)} of the server: {DECIDE}"


REPORTED = re.compile(
    r'(?:report|new Shown|new Changes)\(\s*(?:kind === "audio" \? "(\w+)" : )?"(\w+)"'
)


def reported() -> set[str]:
    """Return the types of events that the drive page reports."""
    paths = Path(ROOT / "static" / "js").rglob("*.js")
    found = [pair for path in paths for pair in REPORTED.findall(path.read_text())]
    return {word for pair in found for word in pair if word}


def test_every_event_that_the_page_reports_is_listed():
    types = reported()
    assert {"cue_shown", "layout", "microphone", "camera", "check", "practice_ended"} <= types
    source = (ROOT / "static/js/input/focus_loss.js").read_text()
    lost = set(re.findall(r'letGo\("(\w+)"\)', source))
    assert lost == {"blur", "pagehide", "hidden"}
    undecided = (types | lost) - set(EVENTS["page"])
    assert not undecided, f"event {sorted(undecided)} of pages: {DECIDE}"


def test_every_field_of_a_coded_event_has_a_form():
    assert set(CODING_EDIT) == {one.name for one in CodingEdit._meta.concrete_fields}, DECIDE


def test_coded_event_leaves_with_the_words_of_its_scheme_alone():
    help_ = Code("help", "Help", "point", modifiers=(Modifier("whom", ("robot",)),))
    listed = coded(CodingScheme(codes=(help_,)))
    event = {"code": "help", "begin": 1.5, "end": None, "comment": "Ada", "at": 5.0}
    left = kept(listed, event | {"modifiers": {"whom": "robot"}}, RELEASE, Origin(0.0))
    assert left == {"code": "help", "begin": 1.5, "end": None, "modifiers": {"whom": "robot"}}
    other = event | {"code": "Ada", "modifiers": {"whom": "Ada", "x": "robot"}}
    assert kept(listed, other, RELEASE, Origin(0.0)) == {"begin": 1.5, "end": None, "modifiers": {}}


# --- exported values ------------------------------------------------------------------------------


def test_action_leaves_with_its_result_but_without_ids_hashes_and_times():
    data = {"actionId": PHOTO, "status": "FINISHED", "type": "photo"}
    data["result"] = {"sha256": "ab" * 32, "bytes": 9.5, "stamp": GRANTED + 14.5, "by": "zoe"}
    released = {"actionId": RELEASE.names.thing(PHOTO), "result": {"bytes": 9.5, "stamp": 12.5}}
    assert leaves("robot", "action", data, offset=2.0) == data | released


def test_photo_has_the_same_pseudonym_in_every_event():
    answered = leaves("page", "photo_answer", {"choice": "keep", "photo": PHOTO})
    kept = leaves("task", "photo_kept", {"name": PHOTO, "number": 2})
    assert answered == {"choice": "keep", "photo": RELEASE.names.thing(PHOTO)}
    assert kept == {"name": RELEASE.names.thing(PHOTO), "number": 2}


def test_the_name_of_the_visitor_in_a_robots_event_does_not_leave():
    for kind in ("lease_taken", "estop", "estop_cleared"):
        found = leaves("robot", kind, {"detail": "Zoe", "boot": "b1"}, free_text=True)
        assert found == {"boot": RELEASE.names.thing("b1")}


@pytest.mark.parametrize(
    ("source", "kind", "data"),
    [
        ("robot", "door_changed", {"detail": "hall open"}),
        ("robot", "collision", {"detail": "ahead left"}),
        ("robot", "action", {"reason": "no_picture", "status": "FAILED"}),
        ("server", "ended", {"outcome": "timed_out", "reason": "turn_over"}),
        ("server", "robot_not_ready", {"reason": "charge"}),
        ("page", "link_lost", {"why": "bye_replaced"}),
        ("page", "cue_shown", {"word": "cue.go_to_checkpoint", "number": 2, "seconds": 4.25}),
        ("page", "card_shown", {"word": "lobby", "number": None, "seconds": 1.5}),
        ("page", "layout", {"interface": "novice", "width": 390.0, "touch": True}),
        ("task", "checkpoint", {"number": 1, "pose": {"x": 1.5, "y": 2.0, "theta": -0.5}}),
        ("task", "cue", {"name": "dock_now", "number": 0}),
        ("task", "door_passed", {"name": "hall"}),
        ("task", "task_ended", {"name": "completed"}),
    ],
)
def test_known_words_and_measures_leave_unchanged(source, kind, data):
    assert leaves(source, kind, data) == data


@pytest.mark.parametrize(
    ("source", "kind", "data"),
    [
        ("robot", "door_changed", {"detail": "zoe open"}),
        ("robot", "collision", {"detail": "ahead zoe"}),
        ("robot", "action", {"reason": "198.51.100.7", "status": "zoe", "type": "zoe"}),
        ("robot", "action", {"result": {"zoe": 1.0, "x": "zoe", "stamp": 12.0}}),
        ("server", "ended", {"outcome": "zoe", "reason": "Zoe felt ill"}),
        ("server", "operator_message", {"text": "Hello Zoe", "user": PHOTO}),
        ("page", "link_lost", {"why": "zoe", "more": "zoe"}),
        ("page", "cue_shown", {"word": "zoe", "number": GRANTED, "seconds": GRANTED * 1e3}),
        ("page", "tab", {"hidden": "zoe"}),
        ("page", "permission", {"name": "zoe", "state": 7}),
        ("task", "checkpoint", {"pose": "zoe", "number": GRANTED * 1e9}),
        ("task", "door_passed", {"name": "zoe"}),
    ],
)
def test_value_that_does_not_fit_its_form_does_not_leave(source, kind, data):
    found = leaves(source, kind, data)
    assert found in ({}, {"result": {}}), found


def test_the_code_of_a_reason_leaves_without_its_value():
    data = {"reason": "door_closed: Zoe's room"}
    assert leaves("robot", "action", data, free_text=True) == {"reason": "door_closed"}


@pytest.mark.parametrize("source", ["robot", "server", "page", "task", "nobody"])
def test_event_of_an_unlisted_kind_does_not_leave(source):
    assert leaves(source, "zoe", {"number": 1}) is None


@pytest.mark.parametrize("source", sorted(EVENTS))
def test_no_event_leaks_a_recognisable_value_of_any_message(source):
    fill, known = Filler(GRANTED + 12.5), Known(times=[GRANTED])
    held = [as_stored(fill.message(kind)) for kind in kinds()] + [fill.anything()]
    left = {}
    for kind, listed in EVENTS[source].items():
        deep = {name: fill.anything() for name in listed}
        flat = [{name: value() for name in listed} for value in (fill.word, fill.time, fill.hash)]
        found = [leaves(source, kind, data) for data in (*held, deep, *flat)]
        left[kind] = json.dumps(found).encode()
        known.take("data", [*held, deep, *flat])
    assert traces(left, known) == []
    kept = json.dumps([leaves(source, kind, one, identified=True) for one in held]).encode()
    assert traces({"identified": kept}, known), "the search finds what is there"


def test_every_field_of_every_message_is_filled():
    fill = Filler(GRANTED)
    for kind in kinds():
        filled = msgspec.structs.asdict(fill.message(kind))
        empty = [name for name, value in filled.items() if value in (None, "", (), {}, False)]
        assert not empty, kind


def test_free_text_leaves_on_request_without_the_ids_in_it():
    data = {"text": f"Mind the cat {PHOTO}", "user": PHOTO}
    found = leaves("server", "operator_message", data, free_text=True)
    assert found == {"text": f"Mind the cat {RELEASE.names.thing(PHOTO)}"}


def test_an_identified_dataset_has_everything():
    data = {"detail": "Zoe", "anything": {"sha256": "ab" * 32}}
    assert leaves("page", "anything", data, identified=True) == data


def test_the_code_book_lists_every_type_of_event_with_its_fields_and_their_words():
    (types,) = [one.levels for one in allow_list.event_columns() if one.name == "type"]
    assert set(types) == {kind for kinds in EVENTS.values() for kind in kinds}
    assert types["gamepad"] == "page: there, stick (left | right)"
    assert types["task_ended"].startswith("task: number, pose (x, y, theta), facing (")
    assert "name (completed | timed_out | " in types["task_ended"]
    assert types["collision"].endswith("detail (some of ahead | left | behind | right)")
    assert "reason (begins_anew | idle | " in types["ended"]
    assert "user" not in types["operator_message"]
    assert "robot: " in types["docked"]
    assert "; or task: " in types["docked"]


def test_end_reason_leaves_if_it_is_a_known_word():
    assert allow_list.end_reason("visitor_silent", RELEASE) == "visitor_silent"
    assert allow_list.end_reason("zoe", RELEASE) == ""


def test_acts_of_a_hidden_operator_leave_with_a_pseudonym_and_without_text():
    step = {"step": "hello", "id": "a1", "deviation": "late", "skipped": 0, "by": "9f2c"}
    assert set(wizard_kinds()) <= set(EVENTS["server"])
    left = leaves("server", "wizard_step", step)
    assert (left["step"], left["deviation"], left["skipped"]) == ("hello", "late", 0)
    assert left["by"] == RELEASE.names.thing("9f2c")
    assert leaves("server", "wizard_step", {"step": "Ada Lovelace", "by": "9f2c"}).keys() == {"by"}
    line = {"text": "I know you, Ada", "by": "9f2c"}
    assert leaves("server", "wizard_line", line).keys() == {"by"}
    assert leaves("server", "wizard_line", line, free_text=True)["text"] == line["text"]
    assert leaves("server", "wizard_reached", {"latency": 0.031})["latency"] == 0.031


def wizard_kinds() -> set[str]:
    """Return the types of events that sessions/wizard/leases.py names."""
    words = [value for name, value in vars(wizard_leases).items() if name.isupper()]
    return {word for word in words if isinstance(word, str) and word.startswith("wizard_")}
