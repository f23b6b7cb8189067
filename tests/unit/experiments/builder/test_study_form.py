"""A definition as a form, and back."""

import msgspec
import pytest
from django.http import QueryDict
from django.utils import translation

from experiments.builder.design import StudyDesign
from experiments.builder.labels import GUIDE
from experiments.builder.pages import clicked_point, renumber
from experiments.builder.study_form import StudyPartForm
from experiments.definition.coding import Code
from experiments.definition.plan import StudyPlan
from experiments.definition.schema import Condition, Course, StudyCheckpoint, StudyDefinition
from experiments.definition.shipped import shipped
from experiments.definition.steps.instructions import Instructions
from experiments.definition.steps.task import TaskStep
from experiments.definition.wizard import Wizard, WizardStage
from surveys.document_forms import fields, parts
from surveys.document_forms.part_form import Group
from tests.support.studies.wizard_study import WIZARD

BOTH = ("en", "es")


def groups(form: StudyPartForm | Group):
    for part in form.parts:
        if isinstance(part, Group):
            yield part
            yield from groups(part)


def sent(form: StudyPartForm, **changes: str) -> QueryDict:
    """What a browser sends of a form that was shown, with some fields changed."""
    data = QueryDict(mutable=True)
    for group in groups(form):
        if group.number is not None:
            data[group.name] = group.was
        if group.switch and group.is_on:
            data[group.switch] = "on"
    for one in form:
        if one.field.is_off:
            continue
        if one.field.style == "choices":
            data.setlist(one.name, list(one.value()))
        elif one.field.style != "check" or one.value():
            shown = one.field.as_sent(one.form.initial[one.name])
            data.setlist(one.name, ["on"] if one.field.style == "check" else shown)
    for name, value in changes.items():
        data[name.replace("__", ".")] = value
    return data


def errors(cls: type, document: dict) -> dict[str, str]:
    return StudyPartForm(cls, document, is_sent=True).refusals


def choices(form: StudyPartForm, name: str) -> list[str]:
    return [value for value, _label in form[name].field.widget.choices]


def parts_of(study: StudyDefinition):
    yield from ((type(part), part) for part in (*study.steps, *study.conditions, *study.courses))


@pytest.mark.parametrize("slug", ["exploration", "assistance"])
def test_every_part_of_the_shipped_studies_goes_through_its_form_unchanged(slug):
    for cls, part in parts_of(shipped()[slug]):
        document = msgspec.to_builtins(part)
        found = StudyPartForm.read(cls, sent(StudyPartForm(cls, document, languages=BOTH)))
        assert errors(cls, found) == {}
        kept = {**found, **({"kind": document["kind"]} if "kind" in document else {})}
        assert msgspec.convert(kept, cls) == part


def test_the_whole_study_goes_through_its_form_unchanged():
    study = shipped()["exploration"]
    only = ("title", "intro", "source", "licence", "languages")
    only += ("allocation", "refill", "quality", "analysis")
    document = msgspec.to_builtins(study)
    form = StudyPartForm(StudyDefinition, document, languages=BOTH, only=only)
    found = StudyPartForm.read(StudyDefinition, sent(form), only=only)
    rest = {key: value for key, value in document.items() if key not in only}
    assert msgspec.convert({**rest, **found}, StudyDefinition) == study


def task(**changes: str) -> QueryDict:
    document = {"kind": "task", "key": "task", "title": {"en": "TaskStep"}}
    return sent(StudyPartForm(TaskStep, document, languages=BOTH), **changes)


def test_invalid_number_is_an_error_of_its_field_and_stays_as_typed():
    document = StudyPartForm.read(TaskStep, task(minutes="a quarter", last_minutes="-1"))
    found = errors(TaskStep, document)
    assert found["minutes"] == "This is not a number."
    assert found["last_minutes"] == "Write a number of at least 0."
    form = StudyPartForm(TaskStep, document, languages=["en"], is_sent=True)
    assert form["minutes"].value() == "a quarter"
    assert list(form["minutes"].errors) == ["This is not a number."]
    assert 'value="a quarter"' in str(form["minutes"])


@pytest.mark.parametrize("text", ["nan", "inf", "1e999", "1 000"])
def test_numbers_that_are_no_lengths_of_time_are_refused(text):
    assert "minutes" in errors(TaskStep, StudyPartForm.read(TaskStep, task(minutes=text)))


def test_an_empty_field_has_the_default_of_its_class():
    found = StudyPartForm.read(TaskStep, task(minutes=""))
    assert found.get("minutes") is None
    assert msgspec.convert({"kind": "task", **found}, TaskStep).minutes == 15.0


def test_a_comma_is_a_decimal_mark_in_spanish_and_refused_in_english():
    with translation.override("es"):
        assert StudyPartForm.read(TaskStep, task(minutes="2,5"))["minutes"] == 2.5
    for text in ("2,5", "1,000"):
        form = StudyPartForm.read(TaskStep, task(minutes=text))
        assert errors(TaskStep, form)["minutes"].startswith("Use a decimal point and no comma")


def test_texts_in_other_languages_are_shown_until_they_are_emptied():
    document = {"key": "task", "title": {"en": "TaskStep", "fr": "Tâche"}}
    form = StudyPartForm(TaskStep, document, languages=["en"])
    shown = [one.field.language for one in form if one.field.member.key == "title"]
    assert shown == ["en", "fr"]
    assert StudyPartForm.read(TaskStep, sent(form, title__fr=""))["title"] == {"en": "TaskStep"}


def test_choices_are_offered_and_former_choices_stay():
    document = msgspec.to_builtins(shipped()["exploration"].conditions[1])
    offered = {"robot": ["rhodon"], "doors_closed": ["lounge-door"]}
    form = StudyPartForm(Condition, document, languages=["en"], offered=offered)
    assert form["robot"].field.style == "choice"
    assert choices(form, "robot") == ["rhodon", "giraff"]
    assert form["doors_closed"].field.style == "choices"
    assert choices(form, "doors_closed") == ["lounge-door", "lab-door"]
    assert choices(form, "actions") == ["places", "map", "follow", "dock", "undock", "tilt"]


def test_an_optional_part_is_switched_on_and_off():
    document = msgspec.to_builtins(shipped()["exploration"].conditions[0])
    form = StudyPartForm(Condition, document, languages=BOTH)
    assert {group.switch: group.is_on for group in groups(form) if group.switch} == {
        "network.control.on": False,
        "network.video.on": False,
    }
    delay = {"network__control__on": "on", "network__control__delay": "0.2"}
    on = StudyPartForm.read(Condition, sent(form, **delay))
    assert on["network"]["control"]["delay"] == 0.2
    assert "video" not in on["network"]


def test_errors_inside_lists_say_which_part():
    leaves = [{"text": {"en": "Read"}}, {"text": {"en": "On"}, "picture": "No Picture!"}]
    found = errors(Instructions, {"key": "how", "title": {}, "leaves": leaves})
    assert list(found) == ["leaves.1.picture"]


def test_the_photo_stays_with_its_checkpoint_when_checkpoints_move():
    course = {"checkpoints": [{"number": n} for n in (0, 2, 1)], "photo": {"checkpoint": 2}}
    numbered = [{"number": n} for n in (0, 1, 2)]
    assert renumber(course) == {"checkpoints": numbered, "photo": {"checkpoint": 1}}


def test_the_photo_of_a_removed_checkpoint_is_kept_for_the_check():
    course = {"checkpoints": [{"number": 0}], "photo": {"checkpoint": 2}}
    assert renumber(course)["photo"] == {"checkpoint": 2}


def test_no_number_of_a_checkpoint_is_asked_for():
    assert "number" not in [member.key for member in parts.members(GUIDE, StudyCheckpoint)]


def test_leaving_a_language_takes_its_texts_everywhere():
    study = msgspec.to_builtins(shipped()["exploration"])

    def texts(*languages):
        return msgspec.json.encode(parts.in_languages(StudyDefinition, study, languages)).decode()

    assert '"es":' not in texts("en")
    assert texts("en", "es") == msgspec.json.encode(study).decode()


def test_a_click_on_the_map_is_a_point_and_anything_else_is_not():
    assert clicked_point("1.5 2", (0.0, 0.0)) == (1.5, 2.0)
    for at in ("", "x", "1 2 3", "1 2\n3 4"):
        assert clicked_point(at, (4.0, 5.0)) == (4.0, 5.0)


def test_an_optional_part_that_is_off_lacks_nothing():
    course = {"robot": "giraff", "site": "office", "checkpoints": []}
    assert errors(Course, course) == {}
    assert list(errors(Course, {**course, "photo": {}})) == ["photo.checkpoint", "photo.mirror"]


def test_levels_ask_for_what_their_factor_changes():
    levels = [{"key": "a", "title": {}, "sets": {"video_delay": 0.3}}, {"key": "b", "title": {}}]
    design = {
        "factors": [{"key": "f", "title": {}, "changes": ["video_delay"], "levels": levels}],
        "shared": {},
        "allocation": {},
    }
    form = StudyPartForm(StudyDesign, design, languages=["en"], offered={"shared": ()})
    asked = [name for name in form.fields if ".sets." in name]
    assert asked == [f"factors.0.levels.{n}.sets.video_delay" for n in (0, 1)]
    data = sent(form, factors__0__levels__1__sets__video_delay="0")
    found = StudyPartForm.read(StudyDesign, data)
    assert [level["sets"] for level in found["factors"][0]["levels"]] == [
        *({"video_delay": 0.3}, {"video_delay": 0.0})
    ]


def test_expectation_of_a_hypothesis_is_one_choice():
    claims = {"Delay": {"greater:main::delay.help": "It depends", "less:main:2:": "Less"}}
    one = {"key": "h1", "direction": "greater", "analysis": "main", "effect": "delay:help"}
    form = StudyPartForm(StudyPlan, {"hypotheses": [one]}, offered={"claims": claims})
    assert form["hypotheses.0.direction"].value() == "greater:main::delay.help"
    found = StudyPartForm.read(StudyPlan, sent(form, hypotheses__0__direction="less:main:2:"))
    assert found["hypotheses"] == [
        {"key": "h1", "direction": "less", "measures": [], "analysis": "main", "contrast": 2}
    ]


def test_a_step_of_a_script_has_a_line_or_the_fields_of_its_move():
    for stage in WIZARD["stages"]:
        form = StudyPartForm(WizardStage, stage, languages=["en"])
        data = sent(form)
        data.update(kinds_of(form))
        found = StudyPartForm.read(WizardStage, data)
        assert msgspec.convert(found, WizardStage) == msgspec.convert(stage, WizardStage)
    form = StudyPartForm(WizardStage, WIZARD["stages"][0], languages=["en"])
    assert {"steps.0.line.en", "steps.0.aloud", "steps.1.move.angle"} <= set(form.fields)
    assert not {"steps.1.line.en", "steps.1.aloud"} & set(form.fields)


def kinds_of(form: StudyPartForm) -> QueryDict:
    """What the hidden fields of a form send of moves."""
    data = QueryDict(mutable=True)
    for group in groups(form):
        if group.kind:
            data[f"{group.name}.kind"] = group.kind
    return data


def test_lists_with_own_pages_have_no_fields():
    assert "stages" not in [member.key for member in parts.members(GUIDE, Wizard)]


def test_values_of_a_modifier_may_have_spaces_and_have_commas_between():
    code = {"code": "help", "name": "Help", "kind": "point"}
    whom = {"name": "whom", "values": ["the robot", "a visitor"]}
    form = StudyPartForm(Code, code | {"modifiers": [whom]})
    assert form["modifiers.0.values"].value() == "the robot, a visitor"
    assert StudyPartForm.read(Code, sent(form))["modifiers"] == [whom]


def test_a_word_of_one_class_comes_before_that_of_all():
    member = {one.key: one for one in parts.members(GUIDE, Code)}["key"]
    label = str(fields.field_of(member).label)
    assert label == "Key on the replay"
    assert str(fields.field_of(parts.members(GUIDE, WizardStage)[0]).label) == "Short name"


def test_lists_of_a_form_are_those_of_its_class():
    design = {"factors": [{"key": "delay"}]}
    assert StudyPartForm.list_in(design, "factors.0.levels", StudyDesign) == []
    assert StudyPartForm.list_in(design, "allocation.balance", StudyDesign) == []
    assert design == {"factors": [{"key": "delay", "levels": []}], "allocation": {"balance": []}}
    for name in ("steps", "factors.1.levels", "factors.levels", "factors.0.key", "allocation", ""):
        assert StudyPartForm.list_in(design, name, StudyDesign) is None, name


def test_lists_that_have_pages_of_their_own_are_in_no_other_form():
    study = {"steps": [], "wizard": {"stages": []}}
    for name in ("steps", "factors", "wizard.stages"):
        assert StudyPartForm.list_in(study, name, StudyDefinition, ["wizard"]) is None, name
