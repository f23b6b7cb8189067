"""The safety document as data, and the results of tests."""

import pytest

from telepresence_site.ops.safety_file import document, test_results as outcomes

PAGE = """# Safety

| What fails | What stops the robot | Within | Tests |
| --- | --- | --- | --- |
| the page | the `kernel` ([below](#who)) | 350 ms | `test_silence`, `test_kernel.py` |

| Rule | Bound | Code | Test | Figure |
| --- | --- | --- | --- | --- |
| it **brakes** | 0.3 s | `Kernel.braking` | `test_silence` | 0.30 s |

| What fails | Detected by | What the robot does | Within | Reads | Recorded | Tests |
| --- | --- | --- | --- | --- | --- | --- |
| broker | its connection | stops | 10 s | "…" | – | F, P |

- F: `tests/a/test_{file}.py::test_driver_sees_it`,
  `tests/a/test_{file}.py::test_robot_stops`
- P: `tests/b/test_{file}.py::test_page_says_so`

The end.
""".replace("{file}", "faults")
JUNIT = """<?xml version="1.0"?><testsuites><testsuite tests="5" timestamp="2026-11-28T12:00:00">
<testcase classname="tests.unit.test_kernel" name="test_silence[a]"/>
<testcase classname="tests.unit.test_kernel" name="test_silence[b]"><failure/></testcase>
<testcase classname="tests.unit.test_kernel.TestMore" name="test_other"/>
<testcase classname="tests.a.test_faults" name="test_robot_stops"><skipped/></testcase>
<testcase classname="tests.a.test_faults" name="test_driver_sees_it"/>
</testsuite></testsuites>"""


def test_tables_become_plain_texts_with_the_names_of_their_tests():
    found = document.parsed(PAGE)
    [hazard], [rule], [part] = found.hazards, found.functions, found.parts
    assert hazard.cells == ("the page", "the kernel (below)", "350 ms")
    assert hazard.tests == ("test_silence", "test_kernel.py")
    assert rule.cells == ("it brakes", "0.3 s", "Kernel.braking", "0.30 s")
    assert part.cells == ("broker", "its connection", "stops", "10 s")
    assert part.tests == ("test_driver_sees_it", "test_robot_stops", "test_page_says_so")


def test_a_page_without_the_tables_is_refused():
    with pytest.raises(ValueError, match="no table"):
        document.parsed("# Safety\n")


def test_a_test_failed_if_one_of_its_cases_failed_and_did_not_run_if_it_is_not_in_the_file(
    tmp_path,
):
    path = tmp_path / "results.xml"
    path.write_text(JUNIT, encoding="utf-8")
    results = outcomes.read([path])
    assert results.of("test_silence") == "failed (1 of 2)"
    assert results.of("test_other") == "passed (1 of 1)"
    assert results.of("test_kernel.py") == "failed (1 of 3)"
    assert results.of("test_robot_stops") == "skipped"
    assert results.of("test_nothing") == outcomes.NOT_RUN
    assert results.runs == ["results.xml: 5 tests, 2026-11-28T12:00:00"]


@pytest.mark.parametrize("text", ["no xml", "<html></html>"])
def test_a_file_that_is_none_of_pytest_is_refused(tmp_path, text):
    path = tmp_path / "results.xml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match="is no JUnit file"):
        outcomes.read([path])
