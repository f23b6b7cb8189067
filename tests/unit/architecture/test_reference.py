"""Every setting and every command of ours stands in the reference."""

import argparse
import re

from robots.agent.config import add_arguments
from tests.support.paths import ROOT

REFERENCE = ROOT / "docs" / "reference"


def test_every_environment_variable_that_the_settings_read_is_explained():
    sources = [*(ROOT / "telepresence_site").rglob("*.py")]
    read = {
        name
        for path in sources
        for name in re.findall(r'\b(?:text|flag|words)\(\s*"([A-Z_]+)"', path.read_text())
    }
    assert len(read) > 20
    explained = set(re.findall(r"`([A-Z_]+)`", (REFERENCE / "settings.md").read_text()))
    assert read - explained - {"LAN", "RESET", "PORT"} == set()


def test_the_defaults_in_the_reference_are_those_of_the_settings():
    source = (ROOT / "telepresence_site" / "settings.py").read_text()
    found = dict(re.findall(r'\benv\.text\(\s*"([A-Z_]+)", "([^"]*)"\)', source))
    rows = re.findall(
        r"^\| (`[A-Z_`, ]+`) \| (`[^|]+`) \|", (REFERENCE / "settings.md").read_text(), re.MULTILINE
    )
    explained = {
        name: defaults[min(number, len(defaults) - 1)]
        for names, columns in rows
        for defaults in [re.findall(r"`([^`]+)`", columns)]
        for number, name in enumerate(re.findall(r"`([A-Z_]+)`", names))
    }
    assert len(found.keys() & explained.keys()) > 20
    assert {name: explained[name] for name in found if name in explained} == {
        name: found[name] for name in found if name in explained
    }


def test_every_environment_variable_that_tests_and_benchmarks_read_is_explained():
    sources = [path for folder in ("tests", "benchmarks") for path in (ROOT / folder).rglob("*.py")]
    read = {
        name
        for path in sources
        for name in re.findall(r'environ\.get\(\s*"([A-Z_]+)"', path.read_text())
    } - {"PYTEST_XDIST_WORKER"}
    assert len(read) > 10
    page = (ROOT / "docs/development/testing.md").read_text()
    assert read - set(re.findall(r"`([A-Z_]+)`", page)) == set()


def test_every_option_of_the_agent_is_explained():
    parser = argparse.ArgumentParser(add_help=False)
    add_arguments(parser)
    options = {option for action in parser._actions for option in action.option_strings}
    explained = set(
        re.findall(
            r"--[a-z-]+",
            (ROOT / "docs/howto/connect-a-robot.md")
            .read_text()
            .partition("## What the robot must have")[0],
        )
    )
    assert options - explained == set()


def test_every_command_is_explained():
    names = {path.stem for path in ROOT.glob("*/management/commands/*.py")} - {"__init__"}
    assert names
    explained = set(
        re.findall(r"^\| `([a-z_]+)", (REFERENCE / "commands.md").read_text(), re.MULTILINE)
    )
    assert names <= explained


def test_every_link_between_documents_leads_somewhere():
    documents = [*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md")]
    for document in documents:
        for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", document.read_text()):
            assert target.startswith("http") or (document.parent / target).exists(), (
                f"{document.name} points at {target}"
            )
