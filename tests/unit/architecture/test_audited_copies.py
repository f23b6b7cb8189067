"""Whatever hands out copies of data about people is in the audit log, from which people who
withdraw learn of it (accounts.audit.COPIES).
"""

import ast
from collections.abc import Iterator

import pytest

from accounts.audit import COPIES
from tests.support.paths import ROOT

pytestmark = pytest.mark.slow
FOLDERS = ("accounts", "robots", "sessions", "surveys", "experiments")
READERS = {"FileResponse", "as_json", "as_long_csv", "as_wide_csv", "dataset_of", "export_files"}
# Functions that send a file or read a study's data and note nothing, with the reason.
SILENT = {
    "sessions/downloads.py:_download": "its callers note it",
    "robots/admin_pages/interventions.py:interventions_csv": "roles and values, no people",
    "surveys/downloads.py:_download": "its callers note it",
    "sessions/views.py:snapshot": "shows a photo to the visitor who took it",
    "surveys/admin_pages/questionnaire.py:export": "a questionnaire, without answers",
    "experiments/admin.py:export": "the definition of a study",
    "experiments/study_admin/plan.py:preregistration_view": "the plan of a study",
    "experiments/study_admin/rehearsals.py:report_view": "a report on bots",
    "experiments/rehearsal/findings.py:findings": "a report on bots",
    "experiments/participation/withdrawal/receipt.py:receipt_text": "the participant's own receipt",
    "experiments/participation/own_data/views.py:data_download": "the participant's own data",
    "experiments/participation/own_data/views.py:receipt": "the participant's own consent",
    "experiments/management/commands/deposit.py:_written": "its caller notes it",
    "experiments/management/commands/deposit.py:kept": "a part of the same",
    "experiments/export/files.py:_files": "the files of an export, which its callers note",
    "experiments/extraction/build.py:_whole_of": "reads the whole for a part of it",
    "experiments/recruitment/quality.py:flags_of_study": "grades in a table of payments",
}


def functions() -> Iterator[tuple[str, ast.AST, dict[str, ast.AST]]]:
    """Yield each function by its file and name, with all functions of its module by name."""
    for folder in FOLDERS:
        for path in (ROOT / folder).rglob("*.py"):
            every = [
                one
                for one in ast.walk(ast.parse(path.read_text()))
                if isinstance(one, ast.FunctionDef | ast.AsyncFunctionDef)
            ]
            beside = {one.name: one for one in every}
            yield from ((f"{path.relative_to(ROOT)}:{one.name}", one, beside) for one in every)


def called(function: ast.AST) -> Iterator[tuple[str, ast.Call]]:
    for one in ast.walk(function):
        if isinstance(one, ast.Call) and isinstance(one.func, ast.Name | ast.Attribute):
            name = one.func.id if isinstance(one.func, ast.Name) else one.func.attr
            yield name, one


def sends(function: ast.AST) -> bool:
    words = {one.value for one in ast.walk(function) if isinstance(one, ast.Constant)}
    return "Content-Disposition" in words or any(name in READERS for name, _ in called(function))


def noted(function: ast.AST) -> set[str]:
    calls = (call for name, call in called(function) if name == "note" and call.args)
    first = (call.args[0] for call in calls)
    return {str(one.value) for one in first if isinstance(one, ast.Constant)}


def test_every_function_that_hands_out_data_notes_it_as_a_copy():
    silent = set()
    for name, function, beside in functions():
        own = [function, *(beside[it] for it, _ in called(function) if it in beside)]
        if sends(function) and not any(noted(one) & set(COPIES) for one in own):
            silent.add(name)
    assert silent == set(SILENT)


def test_every_act_of_exporting_is_declared_and_noted_somewhere():
    acts = set().union(*(noted(function) for _, function, _ in functions()))
    assert set(COPIES) <= acts
    exporting = {act for act in acts if act.endswith(("exported", "deposited", "_api"))}
    assert exporting <= set(COPIES)
