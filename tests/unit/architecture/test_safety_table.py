"""What docs/explanation/safety.md says of parts that fail is what stands in the code: its tests,
its sentences, its words.
"""

import html
import re
import typing

from sessions import protocol
from telepresence_site.ops.safety_file import document as safety_document
from tests.support.paths import ROOT

PAGE = (ROOT / "docs/explanation/safety.md").read_text(encoding="utf-8")
SECTION = PAGE.partition("## If a part fails")[2]
RULES = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in PAGE.partition("| Rule | Bound |")[2].partition("\n\n")[0].splitlines()[2:]
]
TESTS = [*(ROOT / "tests").rglob("test_*.py")]
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in SECTION.splitlines()
    if line.startswith("| ")
][2:]


def test_every_part_that_a_page_can_be_told_of_has_its_row():
    named = {
        "broker": "broker",
        "session_manager": "session manager",
        "database": "database",
        "disk_low": "disk",
        "disk_full": "disk",
        "robot": "agent",
    }
    assert set(named) == set(typing.get_args(typing.get_type_hints(protocol.Fault)["part"]))
    firsts = " ".join(row[0] for row in ROWS)
    assert [name for name in named.values() if name not in firsts] == []


def test_every_row_is_whole_and_names_tests_that_there_are():
    for row in ROWS:
        assert len(row) == 7, row[0]
        assert all(row), row[0]
        for letter in row[6].split(", "):
            assert f"\n- {letter}: `tests/" in SECTION, f"{row[0]}: {letter}"
    named = re.findall(r"`(tests/[^`]+\.py)::(\w+)`", SECTION)
    assert len(named) >= 12
    assert [
        (file, test)
        for file, test in named
        if f"def {test}(" not in (ROOT / file).read_text(encoding="utf-8")
    ] == []


def test_sentences_quoted_for_visitors_are_on_the_page():
    words = html.unescape(
        "".join(
            (ROOT / "templates/sessions" / name).read_text(encoding="utf-8")
            for name in ("_words.html", "_fault_words.html")
        )
    )
    sentences = [sentence for row in ROWS for sentence in re.findall(r'"([^"]+)"', row[4])]
    assert len(sentences) >= 10
    assert [sentence for sentence in sentences if sentence not in words] == []
    named = re.findall(r'"([^"]+)"', SECTION.partition("A part fails when")[0])
    assert len(named) == 5
    assert [sentence for sentence in named if sentence not in words] == []


def named(cell):
    return re.findall(r"`([^`]+)`", cell)


def test_every_safety_rule_has_a_bound_code_a_test_and_a_figure():
    assert len(RULES) >= 20
    assert [rule for rule in RULES if len(rule) != 5 or not all(rule)] == []


def test_every_safety_rule_names_a_test_that_exists():
    files, sources = {path.name for path in TESTS}, [path.read_text("utf-8") for path in TESTS]
    missing = [
        (rule[0], test)
        for rule in RULES
        for test in named(rule[3]) or ["none"]
        if test not in files and not any(f"def {test}(" in source for source in sources)
    ]
    assert missing == []


def test_every_hazard_every_rule_and_every_part_names_tests_that_exist():
    files, sources = {path.name for path in TESTS}, [path.read_text("utf-8") for path in TESTS]
    document = safety_document.parsed(PAGE)
    rows = (*document.hazards, *document.functions, *document.parts)
    assert len(document.hazards) >= 13
    assert [row.cells[0] for row in rows if not row.tests] == []
    named = {test for row in rows for test in row.tests}
    assert [
        test
        for test in sorted(named)
        if test not in files and not any(f"def {test}(" in source for source in sources)
    ] == []


def test_every_safety_rule_names_code_that_exists():
    code = {
        path: path.read_text(encoding="utf-8")
        for folder in ("robots", "sessions")
        for path in (ROOT / folder).rglob("*.py")
    }

    def exists(name):
        if name.endswith(".py"):
            return any(path.as_posix().endswith(f"/{name}") for path in code)
        parts = name.split(".")
        words = [f"class {parts[0]}", *(f"def {part}(" for part in parts[1:])]
        whole = any(all(word in source for word in words) for source in code.values())
        return whole or any(f"def {name}(" in source for source in code.values())

    missing = [(rule[0], name) for rule in RULES for name in named(rule[2]) if not exists(name)]
    assert missing == []
    assert all(named(rule[2]) for rule in RULES)
