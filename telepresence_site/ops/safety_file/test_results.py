"""Which tests ran, by files that pytest wrote with --junitxml."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree as ET

NOT_RUN = "not run here"


@dataclass
class TestResults:
    """The cases of all files by the name of their function and of their file, and when each file
    was written.
    """

    __test__ = False  # no class of tests

    cases: dict[str, Counter[str]] = field(default_factory=dict)
    runs: list[str] = field(default_factory=list)

    def of(self, test: str) -> str:
        """Return in words how a test went; `test` is a function, or a file that ends with .py."""
        found = self.cases.get(test)
        if not found:
            return NOT_RUN
        for outcome in ("failed", "passed"):
            if found[outcome]:
                return f"{outcome} ({found[outcome]} of {found.total()})"
        return "skipped"


def read(paths: Iterable[Path]) -> TestResults:
    """Read JUnit files. Raises OSError, or ValueError with one sentence."""
    results = TestResults()
    for path in paths:
        try:
            root = ET.fromstring(path.read_bytes())  # noqa: S314 -- the operator's own file
        except ET.ParseError as error:
            raise ValueError(f"{path} is no JUnit file: {error}") from error
        suites = list(root.iter("testsuite"))
        if not suites:
            raise ValueError(f"{path} is no JUnit file: it has no testsuite")
        results.runs += [
            f"{path.name}: {suite.get('tests', '0')} tests, {suite.get('timestamp', 'no time')}"
            for suite in suites
        ]
        for case in root.iter("testcase"):
            _take(results, case)
    return results


def _take(results: TestResults, case: ET.Element) -> None:
    outcome = "passed"
    if case.find("failure") is not None or case.find("error") is not None:
        outcome = "failed"
    elif case.find("skipped") is not None:
        outcome = "skipped"
    name = case.get("name", "").partition("[")[0]
    module = next(
        (part for part in case.get("classname", "").split(".") if part.startswith("test_")), ""
    )
    for key in {name, f"{module}.py"}:
        results.cases.setdefault(key, Counter())[outcome] += 1
