"""Forms of the parts of any family of documents: lists, points, parts of several kinds."""

from urllib.parse import urlencode

import msgspec
import pytest
from django.http import QueryDict

from surveys.document_forms.guide import FormGuide
from surveys.document_forms.part_form import MOST_LISTED, PartForm
from surveys.document_forms.parts import change
from surveys.documents import DocumentPart, Text


class Turn(DocumentPart, frozen=True, kw_only=True, tag_field="kind", tag="turn"):
    angle: float


class Wait(DocumentPart, frozen=True, kw_only=True, tag_field="kind", tag="wait"):
    seconds: float = 1.0


class Act(DocumentPart, frozen=True, kw_only=True):
    line: Text = {}
    move: Turn | Wait | None = None


class Stop(DocumentPart, frozen=True, kw_only=True):
    number: int
    radius: float = 0.5


class Walk(DocumentPart, frozen=True, kw_only=True):
    path: tuple[tuple[float, float], ...] = ()
    stops: tuple[Stop, ...] = ()
    acts: tuple[Act, ...] = ()


class WalkForm(PartForm):
    guide = FormGuide(
        labels={name: name for name in ("path", "stops", "acts", "line", "radius")},
        hints={},
        items={"stops": "Stop", "acts": "Act"},
        choices={"move": {"turn": "Turn around", "wait": "Wait"}},
        hidden={Stop: frozenset({"number"})},
        instead={Act: {"move": frozenset({"line"})}},
    )


def read(sent: str) -> dict:
    return WalkForm.read(Walk, QueryDict(sent))


def refusals(walk: dict) -> dict[str, str]:
    return WalkForm(Walk, walk, is_sent=True).refusals


def test_points_are_written_one_a_line_and_read_again():
    walk = read("path=1+2%0D%0A%0D%0A-0.5;3.25")
    assert walk["path"] == [[1.0, 2.0], [-0.5, 3.25]]
    assert msgspec.convert(walk, Walk).path == ((1.0, 2.0), (-0.5, 3.25))
    assert WalkForm(Walk, walk)["path"].value() == "1 2\n-0.5 3.25"
    assert refusals(walk) == {}


@pytest.mark.parametrize("path", ["1", "1 2 3", "1 2\nx y", "[[1,2]]"])
def test_invalid_points_are_reported_and_kept(path):
    walk = read(urlencode({"path": path}))
    assert walk["path"] == path
    assert refusals(walk) == {"path": "Write one point per line: x and y in metres."}


def test_parts_numbered_by_their_place_are_counted_from_0():
    walk = read("stops.0=&stops.0.radius=1&stops.1=&stops.1.radius=")
    assert walk["stops"] == [{"number": 0, "radius": 1.0}, {"number": 1}]
    (stops,) = (part for part in WalkForm(Walk, walk).parts if part.name == "stops")
    assert [(one.label, one.called) for one in stops.parts] == [("Stop", 0), ("Stop", 1)]


def test_a_part_of_one_kind_has_the_fields_of_its_kind_alone():
    acts = [{"line": {"en": "Come in"}}, {"move": {"kind": "turn", "angle": 90.0}}]
    form = WalkForm(Walk, {"acts": acts}, languages=["en"])
    assert list(form.fields) == ["path", "acts.0.line.en", "acts.1.move.angle"]
    (group,) = (part for part in form.parts if part.name == "acts")
    assert [one.label for one in group.parts[1].parts] == ["Turn around"]
    walk = read(
        "acts.0=&acts.0.line.en=Come+in"
        "&acts.1=&acts.1.line.en=No&acts.1.move.kind=turn&acts.1.move.angle=90"
    )
    assert walk["acts"] == acts
    assert msgspec.convert(walk, Walk).acts[1].move == Turn(angle=90.0)


def test_a_part_of_a_kind_that_is_none_is_no_part():
    assert read("acts.0=&acts.0.move.kind=fly&acts.0.move.angle=90")["acts"] == [{}]


def test_a_forged_list_does_not_run_away():
    assert len(read("&".join(f"acts.{n}=" for n in range(900)))["acts"]) == MOST_LISTED


def test_parts_of_a_list_are_moved_copied_and_removed():
    assert change(["a", "b", "c"], "up", 2) == ["a", "c", "b"]
    assert change(["a", "b", "c"], "down", 0) == ["b", "a", "c"]
    assert change(["a", "b"], "up", 0) == ["a", "b"]
    assert change(["a", "b"], "down", 1) == ["a", "b"]
    assert change(["a", "b"], "copy", 0) == ["a", "a", "b"]
    assert change(["a", "b"], "remove", 1) == ["a"]
    for verb, n in (("remove", 2), ("remove", -1), ("burn", 0)):
        assert change(["a", "b"], verb, n) == ["a", "b"]
