"""One name is one class, so that a search for it finds one thing."""

import ast
from collections import defaultdict
from pathlib import Path

from tests.support.paths import ROOT

PACKAGES = (
    "accounts",
    "benchmarks",
    "deploy",
    "experiments",
    "robots",
    "sessions",
    "surveys",
    "telepresence_site",
)
# Django and msgspec look for these under these names.
GIVEN = {"Command", "Meta"}
# A message and the row that stores it, or a message of ours and the one of ROS, are one thing.
SHARED = {
    "FloorPlan": "the plan of a site as a document, and the row that stores it",
    "LaserScan": "a sweep of a laser, and the message of ROS that brings it",
    "Lease": "the message that grants a robot, and the row that it is sent from",
    "Pose": "where a robot is, and the message of ROS that says so",
    "State": "the message of a robot, and the state of the session in its row",
}


def classes_in(source: str) -> set[str]:
    return {node.name for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ClassDef)}


def files_by_class(sources: dict[str, str]) -> dict[str, list[str]]:
    found = defaultdict(list)
    for path, source in sources.items():
        for name in classes_in(source) - GIVEN:
            found[name].append(path)
    return found


def shared_names(sources: dict[str, str]) -> dict[str, list[str]]:
    return {name: paths for name, paths in files_by_class(sources).items() if len(paths) > 1}


def sources() -> dict[str, str]:
    paths = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    return {
        shown(path): path.read_text("utf-8") for path in paths if "migrations" not in path.parts
    }


def shown(path: Path) -> str:
    return str(path.relative_to(ROOT))


def test_no_two_files_have_a_class_of_the_same_name():
    shared = shared_names(sources())
    assert {name: paths for name, paths in shared.items() if name not in SHARED} == {}
    assert set(SHARED) == set(shared), "what is shared no more needs no exception"


def test_exceptions_stay_few():
    assert len(SHARED) <= 5


def test_a_name_in_two_files_is_found_also_inside_of_another_class():
    found = shared_names(
        {"a.py": "class Card: ...", "b.py": "class Page:\n    class Card: ...", "c.py": ""}
    )
    assert found == {"Card": ["a.py", "b.py"]}
