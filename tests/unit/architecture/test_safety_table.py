"""What docs/explanation/safety.md says of parts that fail is what stands in the code: its tests,
its sentences, its words.
"""

import html
import re
import typing

from sessions import protocol
from tests.support.paths import ROOT

SECTION = (
    (ROOT / "docs/explanation/safety.md")
    .read_text(encoding="utf-8")
    .partition("## If a part fails")[2]
)
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


def test_what_a_visitor_is_said_to_read_stands_on_the_page():
    words = html.unescape((ROOT / "templates/sessions/_words.html").read_text(encoding="utf-8"))
    sentences = [sentence for row in ROWS for sentence in re.findall(r'"([^"]+)"', row[4])]
    assert len(sentences) >= 10
    assert [sentence for sentence in sentences if sentence not in words] == []
    named = re.findall(r'"([^"]+)"', SECTION.partition("A part fails when")[0])
    assert len(named) == 5
    assert [sentence for sentence in named if sentence not in words] == []
