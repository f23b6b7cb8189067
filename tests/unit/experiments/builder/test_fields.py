"""A definition as a form, and back."""

import msgspec
import pytest
from django.http import QueryDict

from experiments.builder import fields as builder
from experiments.builder.fields import Asking, Field, Group
from experiments.definition.schema import Checkpoint, Condition, Course, Study
from experiments.definition.shipped import shipped
from experiments.definition.steps.instructions import Instructions
from experiments.definition.steps.task import Task

BOTH = Asking(("en", "es"))


def fields(group: Group):
    for part in group.parts:
        yield from fields(part) if isinstance(part, Group) else [part]


def groups(group: Group):
    yield group
    for part in group.parts:
        if isinstance(part, Group):
            yield from groups(part)


def sent(form: Group, **changes: str) -> QueryDict:
    """What a browser sends of a form that was shown, with some fields changed."""
    data = QueryDict(mutable=True)
    for group in groups(form):
        if group.number is not None:
            data[group.name] = ""
        if group.switch and group.is_on:
            data[group.switch] = "on"
    off = tuple(f"{group.name}." for group in groups(form) if not group.is_on)
    for one in fields(form):
        if one.name.startswith(off):
            continue
        if one.widget == "choices":
            data.setlist(one.name, list(one.value or ()))
        elif one.widget != "check" or one.value:
            data[one.name] = "on" if one.widget == "check" else str(one.value)
    for name, value in changes.items():
        data[name.replace("__", ".")] = value
    return data


def parts_of(study: Study):
    yield from ((type(part), part) for part in (*study.steps, *study.conditions, *study.courses))


@pytest.mark.parametrize("slug", ["exploration", "assistance"])
def test_every_part_of_the_shipped_studies_goes_through_its_form_unchanged(slug):
    for cls, part in parts_of(shipped()[slug]):
        document = msgspec.to_builtins(part)
        told = builder.read(cls, sent(builder.ask(cls, document, BOTH)))
        assert builder.errors(cls, told) == {}
        kept = {**told, **({"kind": document["kind"]} if "kind" in document else {})}
        assert msgspec.convert(kept, cls) == part


def test_the_whole_study_goes_through_its_form_unchanged():
    study = shipped()["exploration"]
    only = (
        "title",
        "intro",
        "source",
        "licence",
        "languages",
        "allocation",
        "refill",
        "quality",
        "analysis",
    )
    document = msgspec.to_builtins(study)
    told = builder.read(Study, sent(builder.ask(Study, document, BOTH, only=only)), only=only)
    rest = {key: value for key, value in document.items() if key not in only}
    assert msgspec.convert({**rest, **told}, Study) == study


def task(**changes: str) -> QueryDict:
    return sent(
        builder.ask(Task, {"kind": "task", "key": "task", "title": {"en": "Task"}}, BOTH), **changes
    )


def test_what_is_no_number_is_told_at_its_field_and_kept_as_it_was_typed():
    document = builder.read(Task, task(minutes="a quarter", last_minutes="-1"))
    told = builder.errors(Task, document)
    assert told["minutes"] == "This is not a number."
    assert ">= 0.0" in told["last_minutes"]
    form = builder.ask(Task, document, Asking(("en",), errors=told))
    shown = {one.name: one for one in fields(form)}
    assert (shown["minutes"].value, shown["minutes"].error) == (
        "a quarter",
        "This is not a number.",
    )
    assert form.has_error


@pytest.mark.parametrize("text", ["nan", "inf", "1e999", "1 000"])
def test_numbers_that_are_no_lengths_of_time_are_refused(text):
    assert "minutes" in builder.errors(Task, builder.read(Task, task(minutes=text)))


def test_an_empty_field_has_the_value_that_the_class_says():
    assert builder.read(Task, task(minutes="")).get("minutes") is None
    assert (
        msgspec.convert({"kind": "task", **builder.read(Task, task(minutes=""))}, Task).minutes
        == 15.0
    )


def test_a_comma_is_read_as_a_decimal_point():
    assert builder.read(Task, task(minutes="2,5"))["minutes"] == 2.5


def test_texts_in_other_languages_are_shown_until_somebody_empties_them():
    form = builder.ask(
        Task, {"key": "task", "title": {"en": "Task", "fr": "Tâche"}}, Asking(("en",))
    )
    assert [one.language for one in fields(form) if one.key == "title"] == ["en", "fr"]
    assert builder.read(Task, sent(form, title__fr=""))["title"] == {"en": "Task"}


def test_what_may_be_chosen_is_offered_and_what_was_chosen_stays():
    document = msgspec.to_builtins(shipped()["exploration"].conditions[1])
    form = builder.ask(
        Condition,
        document,
        Asking(("en",), offered={"robot": ["rhodon"], "doors_closed": ["lounge-door"]}),
    )
    shown = {one.name: one for one in fields(form)}
    assert (shown["robot"].widget, shown["robot"].choices) == ("choice", ("rhodon", "giraff"))
    assert (shown["doors_closed"].widget, shown["doors_closed"].choices) == (
        "choices",
        ("lounge-door", "lab-door"),
    )
    assert shown["actions"].choices == ("places", "map", "follow", "dock", "undock", "tilt")


def test_an_optional_part_is_switched_on_and_off():
    document = msgspec.to_builtins(shipped()["exploration"].conditions[0])
    form = builder.ask(Condition, document, BOTH)
    assert {group.switch: group.is_on for group in groups(form) if group.switch} == {
        "network.control.on": False,
        "network.video.on": False,
    }
    on = builder.read(
        Condition, sent(form, network__control__on="on", network__control__delay="0.2")
    )
    assert on["network"]["control"]["delay"] == 0.2
    assert "video" not in on["network"]


@pytest.mark.parametrize("path", ["1", "1 2 3", "1 2\nx y", "[[1,2]]"])
def test_points_that_are_none_are_told_and_kept(path):
    document = builder.read(
        Course,
        sent(
            builder.ask(Course, {"robot": "giraff", "site": "office", "checkpoints": []}, BOTH),
            path=path,
        ),
    )
    assert document["path"] == path
    assert builder.errors(Course, document) == {
        "path": "Write one point a line: x and y in metres."
    }


def test_errors_inside_lists_say_which_part():
    leaves = [{"text": {"en": "Read"}}, {"text": {"en": "On"}, "picture": "No Picture!"}]
    told = builder.errors(Instructions, {"key": "how", "title": {}, "leaves": leaves})
    assert list(told) == ["leaves.1.picture"]


def test_parts_of_a_list_are_moved_copied_and_removed():
    assert builder.change(["a", "b", "c"], "up", 2) == ["a", "c", "b"]
    assert builder.change(["a", "b", "c"], "down", 0) == ["b", "a", "c"]
    assert builder.change(["a", "b"], "up", 0) == ["a", "b"]
    assert builder.change(["a", "b"], "down", 1) == ["a", "b"]
    assert builder.change(["a", "b"], "copy", 0) == ["a", "a", "b"]
    assert builder.change(["a", "b"], "remove", 1) == ["a"]
    for verb, n in (("remove", 2), ("remove", -1), ("burn", 0)):
        assert builder.change(["a", "b"], verb, n) == ["a", "b"]


def test_the_photo_stays_with_its_checkpoint_when_checkpoints_move():
    course = {
        "checkpoints": [{"number": 0}, {"number": 2}, {"number": 1}],
        "photo": {"checkpoint": 2},
    }
    assert builder.renumber(course) == {
        "checkpoints": [{"number": 0}, {"number": 1}, {"number": 2}],
        "photo": {"checkpoint": 1},
    }


def test_the_photo_of_a_checkpoint_that_is_gone_is_left_for_the_check_to_tell():
    assert builder.renumber({"checkpoints": [{"number": 0}], "photo": {"checkpoint": 2}})[
        "photo"
    ] == {"checkpoint": 2}


def test_no_number_of_a_checkpoint_is_asked_for():
    assert "number" not in [member.key for member in builder.members(Checkpoint)]


def test_leaving_a_language_takes_its_texts_everywhere():
    study = msgspec.to_builtins(shipped()["exploration"])
    assert '"es":' not in msgspec.json.encode(builder.in_languages(Study, study, ["en"])).decode()
    assert msgspec.json.encode(
        builder.in_languages(Study, study, ["en", "es"])
    ) == msgspec.json.encode(study)


def test_a_click_on_the_map_is_a_point_and_anything_else_is_not():
    assert builder.new_point("1.5 2", (0.0, 0.0)) == (1.5, 2.0)
    for at in ("", "x", "1 2 3", "1 2\n3 4"):
        assert builder.new_point(at, (4.0, 5.0)) == (4.0, 5.0)


def test_a_forged_list_does_not_run_away():
    data = QueryDict("&".join(f"leaves.{n}=" for n in range(900)))
    assert len(builder.read(Instructions, data)["leaves"]) == builder.MOST_LISTED


def test_a_field_is_no_group():
    assert not hasattr(Field("a", "a", "line", ""), "is_group")
