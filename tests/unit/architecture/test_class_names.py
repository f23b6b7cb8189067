"""One name is one class, so that a search for it finds one thing."""

import ast
import re
from collections import Counter, defaultdict

from tests.support.media.sources import python_files, text_of
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
# A message and the row that stores it are one thing.
SHARED = {
    "FloorPlan": "the plan of a site as a document, and the row that stores it",
    "Lease": "the message that grants a robot, and the row that it is sent from",
    "RobotPresence": "what a page reads of a robot's connection, and the row that stores it",
    "State": "the message of a robot, and the state of the session in its row",
}


CLASS = re.compile(r"^[ \t]*class[ \t]+(\w+)", re.MULTILINE)


def classes_in(source: str) -> set[str]:
    return {node.name for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ClassDef)}


def files_by_class(sources: dict[str, str]) -> dict[str, list[str]]:
    """Return the files of each name that is in several. A string may hold the words of a class, so
    that the files of a name are parsed; few are.
    """
    words = {path: set(CLASS.findall(source)) - GIVEN for path, source in sources.items()}
    counts = Counter(name for names in words.values() for name in names)
    found = defaultdict(list)
    for path, names in words.items():
        if any(counts[name] > 1 for name in names):
            for name in classes_in(sources[path]) - GIVEN:
                found[name].append(path)
    return found


def shared_names(sources: dict[str, str]) -> dict[str, list[str]]:
    return {name: paths for name, paths in files_by_class(sources).items() if len(paths) > 1}


def sources() -> dict[str, str]:
    paths = [path for package in PACKAGES for path in python_files(package)]
    return {
        str(path.relative_to(ROOT)): text_of(path)
        for path in paths
        if "migrations" not in path.parts
    }


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


def test_the_words_of_a_class_in_a_string_are_no_class():
    found = shared_names({"a.py": "class Card: ...", "b.py": "TEXT = '''\nclass Card: ...\n'''"})
    assert found == {}
