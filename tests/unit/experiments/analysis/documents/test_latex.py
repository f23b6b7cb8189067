"""Tables as LaTeX: what LaTeX would take for a command is printed as it stands, and a wide table
fits on pages.
"""

import re

import pytest
from hypothesis import given, strategies as st

from experiments.analysis.documents.latex import as_latex, latex
from experiments.analysis.documents.typesetting import MOST_COLUMNS, parts_of
from experiments.analysis.tables.table import Table, count, number, words

GROUPS = [f"{key}: {part}" for key in ("slow", "fast", "none") for part in ("n", "mean", "SD")]
WIDE = Table(
    "conditions",
    "Metrics by condition.",
    ("Measure", "Contrast", *GROUPS, "Test", "p"),
    tuple(
        (words(name), words("a − b"), *(count(n) for n in range(9)), words("t"), number(0.5))
        for name in ("path", "speed")
    ),
    ("A note.",),
)


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        ("50 % & #1_$x$", r"50 \% \& \#1\_\$x\$"),
        (r"\input{x}^~", r"\textbackslash{}input\{x\}\textasciicircum{}\textasciitilde{}"),
        ("a--b", "a-{}-b"),
        ("95 % CI, −1.5 ≤ x", r"95 \% CI, $-$1.5 $\leq$ x"),
        ("Ñu 質問", "Ñu 質問"),
        ("two\nlines", "two lines"),
    ],
)
def test_text_is_printed_unchanged(text, printed):
    assert latex(text) == printed


@given(st.text())
def test_no_text_leaves_a_bare_special_character(text):
    """Whatever is taken out that is escaped, or a command of ours, leaves nothing special."""
    rest = re.sub(
        r"\\(textbackslash|textasciicircum|textasciitilde|textbar|ldots)\{\}", "", latex(text)
    )
    rest = re.sub(
        r"\$(-|\^2|<|>|\\[a-z]+)\$|\\[&%$#_{}]|(?<=-)\{\}|(?<=')\{\}|(?<=`)\{\}", "", rest
    )
    rest = rest.replace("~", "") if "\u00a0" in text else rest
    assert not set(rest) & set("\\&%$#_{}^~|")


def test_a_row_cannot_be_the_argument_of_the_line_break_before_it():
    table = Table("t", "T.", ("", "a"), ((words("[3em]"), words("x")), (words("*"), words("y"))))
    lines = as_latex(table).splitlines()
    assert not any(line.startswith(("[", "*")) for line in lines)
    assert "{}[3em] & x \\\\" in lines


def test_a_wide_table_is_printed_in_parts_that_repeat_what_names_a_row():
    parts = parts_of(WIDE)
    assert len(parts) > 1
    assert all(len(part.head) <= MOST_COLUMNS for part in parts)
    assert all(part.head[:2] == ("Measure", "Contrast") for part in parts)
    shown = [name for part in parts for name in part.head[2:]]
    assert shown == list(WIDE.head[2:])
    assert [part.notes for part in parts] == [(), ("A note.",)]


def test_the_columns_of_a_condition_stay_together():
    for part in parts_of(WIDE):
        subjects = [name.partition(":")[0] for name in part.head if ":" in name]
        assert all(subjects.count(one) == 3 for one in subjects)


def test_parts_have_rules_of_booktabs_and_labels_of_their_own():
    printed = as_latex(WIDE)
    for rule in (r"\toprule", r"\midrule", r"\bottomrule"):
        assert printed.count(rule) == 2
    assert r"\hline" not in printed
    assert re.findall(r"\\label\{(.*)\}", printed) == ["tab:conditions-1", "tab:conditions-2"]
    assert r"slow: \textit{SD}" in printed
