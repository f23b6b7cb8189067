"""Tests as sentences of APA style."""

import numpy as np
import pytest

from experiments.analysis.documents.latex import runs_as_latex
from experiments.analysis.documents.sentences import METHODS, probability, sentences_of
from experiments.analysis.statistics import comparisons, proportions, rank_tests, regression
from experiments.analysis.statistics.comparisons import IntervalEstimate, Test as Found, correlation
from experiments.analysis.tables import comparisons as rows, declared
from experiments.analysis.tables.comparisons import TESTED, ComparedSide, compared, head_of
from experiments.analysis.tables.table import Table

EFFECT = IntervalEstimate(0.49, 0.06, 0.914)
FOUND = Found("paired t", 24, 2.41, (23.0,), 0.0243, IntervalEstimate(), "d_z", EFFECT)
GROUPS = [ComparedSide({"a": 1.0, "b": 3.0}), ComparedSide({"a": 0.5, "b": 1.5})]


def sentence_of(test, corrected=0.0486, groups=GROUPS):
    body = (compared("path", groups, test, corrected),)
    table = Table.of("conditions", "T.", ("Metric", *head_of(("slow", "fast"))), body)
    (sentence,) = sentences_of(table, 0.05)
    return sentence


def test_a_paired_t_test_reads_as_in_a_paper():
    assert sentence_of(FOUND).text == (
        "path: A paired t test showed a significant difference between slow (M = 2.00, SD = 1.41) "
        "and fast (M = 1.00, SD = 0.71), t(23) = 2.41, p = .024, p_Holm = .049, d_z = 0.49, "
        "95% CI [0.06, 0.91]."
    )


def test_the_corrected_value_decides_what_is_significant():
    assert "showed no significant difference" in sentence_of(FOUND, 0.0512).text


def test_the_alpha_of_the_plan_decides_what_is_significant():
    body = (compared("path", GROUPS, FOUND, 0.0486),)
    table = Table.of("conditions", "T.", ("Metric", *head_of(("slow", "fast"))), body)
    for alpha, verdict in ((0.05, "a significant"), (0.01, "no significant")):
        (sentence,) = sentences_of(table, alpha)
        assert f"showed {verdict} difference" in sentence.text


def test_a_test_of_hypotheses_has_a_sentence_for_each_with_p_in_its_family():
    body = (("path", *compared("slow - fast", GROUPS, FOUND, 0.2)),)
    table = Table.of(
        "analysis-a", "T.", ("Measure", "Contrast", *head_of(("first", "second"))), body
    )
    decisions = {("analysis-a", "path", "slow - fast"): [("h1", 0.031), ("h2", 0.06)]}
    first, second = sentences_of(table, 0.05, decisions)
    assert first.text.startswith("h1, path, slow - fast: A paired t test showed a significant")
    assert "p = .024, p_family = .031" in first.text
    assert "Holm" not in first.text
    assert (first.hypothesis, second.hypothesis) == ("h1", "h2")
    assert "showed no significant difference" in second.text


def test_symbols_are_in_italics_in_latex():
    printed = runs_as_latex(sentence_of(FOUND).runs)
    assert r"\textit{t}(23) = 2.41, \textit{p} = .024" in printed
    assert r"\textit{d}\textsubscript{\textit{z}} = 0.49" in printed
    assert r"\textit{p}\textsubscript{Holm}" in printed
    assert r"95\% CI" in printed


@pytest.mark.parametrize(
    ("p", "text"),
    [(0.0243, "= .024"), (0.00099, "< .001"), (0.001, "= .001"), (1.0, "> .999"), (0.05, "= .050")],
)
def test_p_has_three_decimals_and_no_zero_before_the_point(p, text):
    assert probability(p) == text


def test_values_that_cannot_exceed_one_have_no_zero_before_the_point():
    test = correlation(np.arange(9.0), np.array([2.0, 1, 3, 5, 4, 6, 9, 7, 8]) * -1.0)
    row = ("loss", "speed", *rows.tested(test, test.p))
    table = Table.of("n", "N.", ("Of the network", "Of the driving", *TESTED), (row,))
    (sentence,) = sentences_of(table, 0.05)
    assert sentence.text.startswith(
        "loss, speed: Spearman’s rank correlation showed a significant relation, r_s(7) = −.92"
    )
    assert "95% CI [−.9" in sentence.text
    assert "= −0." not in sentence.text


def test_degrees_of_freedom_and_n_stand_where_the_apa_wants_them():
    friedman = Found("Friedman χ²", 12, 6.5, (2.0,), 0.0388, effect_name="W (Kendall)",
                     effect=IntervalEstimate(0.27, 0.1, 0.5))  # fmt: skip
    assert "χ²(2, N = 12) = 6.50, p = .039" in sentence_of(friedman).text
    assert "W = .27, 95% CI [.10, .50]" in sentence_of(friedman).text
    welch = Found("Welch F", 30, 4.1, (2.0, 17.342), 0.035, effect_name="η²p",
                  effect=IntervalEstimate(0.2, 0.0, 0.4))  # fmt: skip
    assert "F(2, 17.34) = 4.10" in sentence_of(welch).text
    assert "η²p = .20" in sentence_of(welch).text
    runs = runs_as_latex(sentence_of(welch).runs)
    assert r"$\eta$\textsuperscript{2}\textsubscript{\textit{p}}" in runs


def test_a_row_without_a_test_has_no_sentence():
    body = (compared("path", GROUPS, Found("–", 0, remark="too few"), float("nan")),)
    table = Table.of("c", "T.", ("Metric", *head_of(("slow", "fast"))), body)
    assert list(sentences_of(table, 0.05)) == []
    assert list(sentences_of(Table.of("t", "T.", ("a",), [("x",)]), 0.05)) == []


def test_every_test_of_the_statistics_has_its_sentence():
    rng = np.random.default_rng(4)
    a, b, c = rng.normal(size=(3, 9)) + np.array([[0.0], [1.0], [2.0]])
    names = {
        comparisons.between(a, b).name,
        comparisons.within(a, b).name,
        comparisons.several_between([a, b, c]).name,
        comparisons.several_within(np.column_stack((a, b, c))).name,
        comparisons.correlation(a, b).name,
        rank_tests.SIGNED,
        rank_tests.RANK_SUM,
        rank_tests.KRUSKAL,
        rank_tests.FRIEDMAN,
        *(proportions.CHI_SQUARE, proportions.BOSCHLOO, proportions.MCNEMAR, proportions.COCHRAN),
        regression.LOG_RANK,
        *declared.TESTS.values(),
    }
    assert names <= set(METHODS)
