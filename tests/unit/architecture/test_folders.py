"""A folder is one idea, and can be read at a glance."""

from collections import Counter

from tests.support.paths import ROOT
from tests.unit.architecture.test_class_names import PACKAGES

MOST_MODULES = 20


def crowded(paths: list[str]) -> dict[str, int]:
    """Return the folders with too many modules, and how many they have."""
    modules = [path for path in paths if not path.endswith("__init__.py")]
    counts = Counter(path.rpartition("/")[0] for path in modules)
    return {folder: count for folder, count in counts.items() if count > MOST_MODULES}


def test_no_folder_has_more_than_twenty_modules():
    files = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    modules = [str(path.relative_to(ROOT)) for path in files if "migrations" not in path.parts]
    assert modules
    assert crowded(modules) == {}


def test_a_folder_with_one_module_too_many_is_found():
    paths = [f"robots/module_{number}.py" for number in range(21)]
    assert crowded([*paths, "robots/__init__.py"]) == {"robots": 21}
    assert crowded([*paths[1:], "robots/__init__.py"]) == {}
