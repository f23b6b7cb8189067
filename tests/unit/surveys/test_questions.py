"""Question types: found by name, whole in their own files."""

import ast

import pytest

from surveys.documents import BadDefinitionError
from surveys.item import Item, Viewing
from surveys.questions import TYPES
from tests.support.media.sources import python_files, text_of
from tests.support.paths import ROOT
from tests.support.studies.questionnaires import NOW, defined, item, rows

FOLDER = ROOT / "surveys" / "questions"
TEMPLATES = ROOT / "templates"


def test_every_module_is_the_type_of_its_name():
    assert set(TYPES) == {path.stem for path in FOLDER.glob("*.py")} - {"__init__"}
    for name, cls in TYPES.items():
        assert cls.__struct_config__.tag == name


def test_an_unknown_type_is_an_error_and_no_other_type():
    with pytest.raises(BadDefinitionError, match="there is no question type “essay”"):
        defined([item("essay", "q")])


@pytest.mark.parametrize("name", sorted(TYPES))
def test_a_type_can_be_asked_answered_and_exported(name):
    more = {"rows": rows("q1", "q2")} if name == "grid" else {}
    question = next(iter(defined([item(name, "q", **more)]).questions()))
    widget = question.item.widget(question, [], Viewing("en", 0, NOW))
    assert (TEMPLATES / widget.template).is_file()
    columns = question.item.columns("q")
    assert len(question.item.cells(None)) == len(columns)
    assert question.item.parse != Item.parse


def imported(path):
    if "surveys.questions." not in text_of(path):
        return
    for node in ast.walk(ast.parse(text_of(path))):
        if isinstance(node, ast.ImportFrom):
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def test_a_question_type_is_named_only_in_its_own_file():
    for app in ("surveys", "experiments", "telepresence_site"):
        for path in python_files(app):
            known = [name for name in imported(path) if name.startswith("surveys.questions.")]
            assert not known, f"{path} imports {known}"
