"""A stored study says everything: no release changes it.

`study_published_before.json` is a study as the release before stored and published it, without the
values by default; `study_complete.json` is the same study with the values that were in force then.
Never change them to make a test pass.
"""

import json
from hashlib import sha256
from importlib import import_module
from types import ModuleType
from typing import Any, get_args

import msgspec
import pytest

from experiments.definition import schema
from experiments.definition.schema import StudyDefinition, as_stored, digest, from_stored
from surveys.documents import fields_of
from tests.support.paths import ROOT
from tests.support.studies.wizard_study import wizard_study

GOLDEN = ROOT / "tests" / "golden"
BEFORE = json.loads((GOLDEN / "study_published_before.json").read_text("utf-8"))
COMPLETE = json.loads((GOLDEN / "study_complete.json").read_text("utf-8"))
MIGRATION = import_module("experiments.migrations.0018_frozen_values")
DECIDE = (
    "what did studies mean that were stored before this field? Write a migration like "
    "0018_frozen_values that gives stored definitions that value"
)


def later_release(*changes: tuple[str, str]) -> ModuleType:
    """The module of the classes as a later release may have it, with other values by default."""
    source = (ROOT / "experiments" / "definition" / "schema.py").read_text("utf-8")
    for before, after in changes:
        assert source.count(before) == 1, before
        source = source.replace(before, after)
    module = ModuleType(schema.__name__)
    exec(compile(source, "schema.py", "exec"), module.__dict__)
    return module


CHANGES = (
    ("gt=0.0, le=1.0)] = 0.75", "gt=0.0, le=1.0)] = 0.5"),
    (
        "least_sample_rate: Annotated[float, Meta(ge=0.0, le=50.0)] = 3.5",
        "least_sample_rate: Annotated[float, Meta(ge=0.0, le=50.0)] = 1.0",
    ),
    (
        'counts: Literal["first", "last", "all"] = "first"',
        'counts: Literal["first", "last", "all"] = "last"',
    ),
    ("docked: bool = True", "docked: bool = False"),
)


def test_study_of_the_previous_release_gets_the_values_that_were_in_force():
    assert MIGRATION.completed(BEFORE["definition"]) == COMPLETE["definition"]
    assert COMPLETE["definition"]["allocation"]["best_probability"] == 1.0


def test_release_with_other_defaults_changes_neither_meaning_nor_digest():
    later = later_release(*CHANGES)
    assert later.StudyDefinition is not StudyDefinition
    there = later.from_stored(COMPLETE["definition"])
    assert later.as_stored(there) == COMPLETE["definition"]
    assert later.digest(there) == COMPLETE["sha256"]
    assert there.quality.least_sample_rate == 3.5
    bare = later.from_stored(BEFORE["definition"])
    assert (bare.quality.least_sample_rate, bare.start.docked) == (1.0, False)


def test_stored_definition_is_read_back_unchanged():
    assert as_stored(from_stored(COMPLETE["definition"])) == COMPLETE["definition"]
    assert digest(from_stored(COMPLETE["definition"])) == COMPLETE["sha256"]


def test_digest_can_be_checked_with_the_exported_file():
    study = from_stored(COMPLETE["definition"])
    found = json.loads(schema.to_json(study))
    text = json.dumps(found, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    assert sha256(text.encode()).hexdigest() == digest(study)


def classes(kind: Any, known: dict[str, type[msgspec.Struct]]) -> dict[str, type[msgspec.Struct]]:
    """All classes of which a definition is made, by the names that the migration has for them."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        tag = kind.__struct_config__.tag
        family = "step" if "repeat" in kind.__struct_fields__ else "move"
        name = f"{family} {tag}" if tag else kind.__name__
        if name not in known:
            known[name] = kind
            for field in fields_of(kind):
                classes(field.type, known)
    for inner in get_args(kind):
        classes(inner, known)
    return known


@pytest.mark.parametrize(("name", "kind"), classes(StudyDefinition, {}).items())
def test_every_field_has_a_value_for_studies_stored_before_it(name, kind):
    optional = {field.encode_name for field in fields_of(kind) if not field.required}
    assert optional == set(MIGRATION.CLASSES[name][0]), f"{name}: {DECIDE}"


def test_hidden_operators_moves_are_completed_too():
    study = wizard_study()
    bare = json.loads(msgspec.json.encode(study))
    assert MIGRATION.completed(bare) == as_stored(study) | {
        "allocation": as_stored(study.allocation) | {"best_probability": 1.0}
    }
