"""Kinds of study steps: found by name, each with its definition and its page."""

import json

import msgspec
import pytest

from experiments.definition.problems import parse
from experiments.definition.schema import StudyDefinition
from experiments.definition.steps import KINDS
from experiments.participation.step_page import StepPage
from experiments.participation.steps import page_type
from surveys.documents import BadDefinitionError
from tests.support.paths import ROOT
from tests.support.studies.studies import STUDY


def test_every_kind_has_a_definition_and_a_page_of_its_name():
    for folder in ("definition", "participation"):
        files = (ROOT / "experiments" / folder / "steps").glob("*.py")
        assert {path.stem for path in files} - {"__init__"} == set(KINDS)
    for kind in KINDS:
        page = page_type(kind)
        assert issubclass(page, StepPage)
        assert page.label
        assert page.show is not StepPage.show


def test_a_blank_step_of_every_kind_can_be_kept():
    for kind in KINDS:
        step = {"kind": kind, "key": "new", "title": {}, **page_type(kind).blank}
        study = {**STUDY, "steps": [step]}
        assert msgspec.convert(study, StudyDefinition).steps[0].kind == kind


def test_an_unknown_kind_is_an_error_and_no_other_kind():
    with pytest.raises(KeyError, match="lottery"):
        page_type("lottery")


def test_import_names_an_unknown_kind():
    with pytest.raises(BadDefinitionError) as caught:
        parse(json.dumps({**STUDY, "steps": [{"kind": "lottery", "key": "new"}]}).encode())
    assert "$.steps[0]: there is no kind of step “lottery”; choose one of " in str(caught.value)
