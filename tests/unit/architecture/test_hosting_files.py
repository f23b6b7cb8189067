"""The files for code hosts, editors and citations are well formed, and the commands in them exist.
No host runs them in the tests.
"""

import json
import re

import pytest
import yaml

from tests.support.paths import ROOT

WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
FORMS = sorted((ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml"))
# Of the Citation File Format 1.2.0: keys of a file, and what each reference must have.
CITATION_KEYS = {
    *("abstract", "authors", "cff-version", "commit", "contact", "date-released", "doi"),
    *("identifiers", "keywords", "license", "license-url", "message", "preferred-citation"),
    *("references", "repository", "repository-artifact", "repository-code", "title", "type"),
    *("url", "version"),
}


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflow_runs_commands_of_the_makefile_without_secrets_or_rights(path):
    text = path.read_text("utf-8")
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
    named = set(re.findall(r"\bmake ([a-z-]+)$", text, re.MULTILINE))
    assert named
    assert named <= targets
    assert "secrets." not in text
    workflow = yaml.safe_load(text)
    assert workflow["permissions"] == {"contents": "read"}
    for job in workflow["jobs"].values():
        assert job["timeout-minutes"] <= 120
        for step in job["steps"]:
            assert re.fullmatch(r"[\w./-]+@v\d+\.\d+\.\d+", step.get("uses", "a@v1.0.0"))


@pytest.mark.parametrize("path", FORMS, ids=lambda path: path.stem)
def test_issue_form_has_questions(path):
    form = yaml.safe_load(path.read_text("utf-8"))
    if path.stem != "config":
        assert form["name"]
        assert form["description"]
        ids = [part["id"] for part in form["body"] if part["type"] != "markdown"]
        assert ids
        assert len(ids) == len(set(ids))


def test_citation_has_the_keys_of_its_format_and_names_the_paper():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert citation["cff-version"] == "1.2.0"
    assert set(citation) <= CITATION_KEYS
    assert citation["authors"]
    assert citation["license"] == "MIT"
    (paper,) = citation["references"]
    assert re.fullmatch(r"10\.\d{4,}/\S+", paper["doi"])
    readme = (ROOT / "README.md").read_text("utf-8").replace("\n", " ")
    assert paper["title"] in readme
    assert all(author["family-names"] in readme for author in paper["authors"])


def test_renovate_leaves_lock_files_alone():
    renovate = json.loads((ROOT / "renovate.json").read_text("utf-8"))
    assert renovate["lockFileMaintenance"] == {"enabled": False}
    assert "pip_requirements" not in renovate["enabledManagers"]
