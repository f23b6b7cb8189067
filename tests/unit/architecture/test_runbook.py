"""What docs/howto/runbook.md tells an operator to run and to look for is what the site has: units,
commands, log events, figures, and the words of /readyz.
"""

import re
from pathlib import Path

import pytest

from robots.api.disk_space import DiskState
from tests.support.paths import ROOT
from tests.unit.architecture.test_architecture_page import PACKAGES, python_files

RUNBOOK = (ROOT / "docs/howto/runbook.md").read_text("utf-8")
UNITS = {path.name for path in (ROOT / "deploy/systemd").iterdir()}
SOURCE = "\n".join(path.read_text("utf-8") for folder in PACKAGES for path in python_files(folder))
EVENT = re.compile(r"\b(?!telepresence)[a-z]+(?:_[a-z]+)+\b")
FIGURE = re.compile(r"\^telepresence_(\w+)")


def units_in(text: str) -> set[str]:
    """Return the units that a text names, without instance and ending."""
    found = re.findall(r"\btelepresence-([a-z-]+[a-z]@?)", text)
    return {f"telepresence-{name}" for name in found} - {"telepresence-mosquitto"}  # a folder


def missing_units(text: str) -> set[str]:
    known = {name.partition(".")[0] for name in UNITS}
    return {unit for unit in units_in(text) if unit not in known}


def missing_events(text: str) -> set[str]:
    """Return what is looked for in logs and that no code says."""
    sought = " ".join(re.findall(r"--grep '?([\w|]+)'?", text))
    table = " ".join(re.findall(r"^ *\| `(\w+)`[^|]* \| ", text, re.MULTILINE))
    return {name for name in EVENT.findall(f"{sought} {table}") if f'"{name}"' not in SOURCE}


def missing_figures(text: str) -> set[str]:
    return {name for name in FIGURE.findall(text) if f'"{name}"' not in SOURCE}


def missing_commands(text: str) -> set[str]:
    known = {path.stem for path in ROOT.glob("*/management/commands/*.py")} | {"shell"}
    return set(re.findall(r"^ +telepresence ([a-z_]+)", text, re.MULTILINE)) - known


def test_every_unit_command_event_and_figure_is_there():
    assert missing_units(RUNBOOK) == set()
    assert missing_commands(RUNBOOK) == set()
    assert missing_events(RUNBOOK) == set()
    assert missing_figures(RUNBOOK) == set()
    assert len(units_in(RUNBOOK)) > 6


def test_shell_commands_are_python_whose_imports_exist():
    commands = re.findall(r'telepresence shell -v 0 -c "(.+)"$', RUNBOOK, re.MULTILINE)
    assert len(commands) >= 4
    for command in commands:
        compile(command, "runbook", "exec")
        for module, names in re.findall(r"from ([\w.]+) import ([\w, ]+);", command):
            if module.partition(".")[0] in PACKAGES:
                path = ROOT / module.replace(".", "/")
                source = path.with_suffix(".py") if path.with_suffix(".py").exists() else path
                for name in names.split(", "):
                    assert has(source, name), f"{module}.{name}"


def has(source: Path, name: str) -> bool:
    if source.is_dir():
        return (source / f"{name}.py").exists()
    return (
        re.search(rf"^(?:class|def) {name}\b", source.read_text("utf-8"), re.MULTILINE) is not None
    )


def test_every_answer_of_readyz_has_its_section():
    health = (ROOT / "telepresence_site/ops/health.py").read_text("utf-8")
    parts = re.findall(r'^        "(\w+)": ', health, re.MULTILINE)
    assert len(parts) == 5
    begin = RUNBOOK.partition("## Begin here")[2].partition("\n## ")[0]
    for word in (*parts, *DiskState.__args__, "none", "silent", "without_broker", "behind"):
        assert word in begin, word


@pytest.mark.parametrize(
    ("text", "missing"),
    [
        ("systemctl restart telepresence-teapot", missing_units),
        ("    telepresence make_coffee", missing_commands),
        ("journalctl -u x --grep kettle_boiled", missing_events),
        ("   | `kettle_boiled` | it is ready | nothing |", missing_events),
        ("grep '^telepresence_cups_total'", missing_figures),
    ],
)
def test_names_that_the_site_does_not_have_are_found(text, missing):
    assert missing(text) != set()
