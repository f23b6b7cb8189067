"""The paper's tables from datasets that are whole, small, empty, or lack things."""

import csv
import io
import statistics
from dataclasses import replace

import msgspec
import numpy as np
import pandas
import pytest
from scipy import stats

from experiments.analysis.documents.latex import as_latex
from experiments.analysis.tables.paper_tables import lines_of, table_1, table_3, table_4, table_5
from experiments.analysis.tables.people import participants_table, table_2
from experiments.analysis.tables.scored_responses import counted
from experiments.analysis.tables.table import (
    NOTHING,
    Table,
    as_csv,
    number,
    probability,
    words,
)
from experiments.dataset.records import (
    Dataset,
    ParticipantRecord,
    ResponseRecord,
    SessionRecord,
)
from experiments.definition.shipped import shipped
from tests.support.analysis.study_dataset import made_up, questionnaires
from tests.support.analysis.tables import labelled
from tests.support.studies.questionnaires import defined, item

STUDY = shipped()["exploration"]
DATASET = made_up(np.random.default_rng(21), 40)
STATEMENTS = [f"q{n}" for n in range(1, 9)]


def answered(*rows, study=STUDY):
    """A dataset of participants who answered so: a mapping each, after a drive each."""
    numbers = range(len(rows))
    sessions = [SessionRecord(f"S{n}", f"P{n}", "giraff", site="office") for n in numbers]
    return of_drives(sessions, rows, study=study)


def of_drives(sessions, rows, *, study=STUDY):
    """A dataset of sessions and the answers after each: a mapping."""
    responses = [
        ResponseRecord(f"R{n}", "experience", session.participant, row, session=session.id)
        for n, (session, row) in enumerate(zip(sessions, rows, strict=True))
    ]
    names = dict.fromkeys(session.participant for session in sessions)
    return Dataset(
        study,
        participants=tuple(map(ParticipantRecord, names)),
        sessions=tuple(sessions),
        responses=tuple(responses),
        questionnaires=questionnaires("experience", "ict"),
    )


def registered(asked, *rows, missing=None):
    """A dataset of participants who answered the questions of the registration."""
    missing = missing or [{}] * len(rows)
    responses = [
        ResponseRecord(f"R{n}", "ict", f"P{n}", values, missing=missing[n])
        for n, values in enumerate(rows)
    ]
    people = tuple(ParticipantRecord(f"P{n}") for n in range(len(rows)))
    asked = (defined(asked, slug="ict"),)
    more = {"participants": people, "responses": tuple(responses), "questionnaires": asked}
    return Dataset(STUDY, **more)


def counting(rule):
    analysis = msgspec.structs.replace(STUDY.analysis, counts=rule)
    return msgspec.structs.replace(STUDY, analysis=analysis)


def frame(dataset):
    found = [one.values for one in counted(dataset, "experience")]
    rows = [{key: one.get(key) for key in STATEMENTS} for one in found]
    return pandas.DataFrame(rows, dtype=float)


def test_table_5_agrees_with_pandas_and_scipy():
    answers = frame(DATASET)
    groups = {
        "Overall": STATEMENTS,
        "Robot teleoperation": ["q1", "q2", "q3"],
        "Task complexity": ["q5", "q6", "q7"],
        "Q7": ["q7"],
    }
    found = labelled(table_5(DATASET))
    for label, keys in groups.items():
        row = found[label]
        scores = answers[keys].mean(axis=1).dropna()
        pooled = answers[keys].stack().dropna()
        for cell, value in zip(row[1:6], (-2, -1, 0, 1, 2), strict=True):
            assert cell.value == pytest.approx(100.0 * (pooled == value).mean())
        assert row[6].value == len(scores)
        assert [cell.value for cell in row[7:9]] == pytest.approx([scores.mean(), scores.std()])
        widths = [stats.norm.ppf(0.5 + level / 2.0) * scores.sem() for level in (0.95, 0.99)]
        assert [cell.value for cell in row[9:11]] == pytest.approx(widths)
        spread = scores.quantile(0.75) - scores.quantile(0.25)
        assert [cell.value for cell in row[11:]] == pytest.approx([scores.median(), spread])


@pytest.mark.parametrize(
    ("interval", "widths"), [("normal", (0.1715, 0.2254)), ("t", (0.1749, 0.2324))]
)
def test_64_respondents_with_a_deviation_of_0_70_have_the_published_half_widths(interval, widths):
    a = 0.7 * (63 / 64) ** 0.5  # half of them a above the mean and half a below: SD (n - 1) is 0.70
    spread = table_5_of_scores([1.0 - a] * 32 + [1.0 + a] * 32, interval)
    assert spread.sd == pytest.approx(0.70)
    assert (spread.ci95, spread.ci99) == pytest.approx(widths, abs=5e-5)


def table_5_of_scores(scores, interval):
    from surveys.likert import Summary, half_width, mean_and_sd

    mean, sd = mean_and_sd(scores)
    n = len(scores)
    widths = [half_width(sd, n, level, interval) for level in (0.95, 0.99)]
    return Summary(n, n, (), None, mean, sd, *widths, None)


def test_a_questionnaire_without_answers_gives_a_table_of_dashes():
    found = table_5(answered())
    assert len(found.rows) == 13
    assert {cell.text for row in found.rows for cell in row[1:]} == {NOTHING, "0"}


def test_one_who_answered_has_a_mean_and_no_deviation():
    row = labelled(table_5(answered(dict.fromkeys(STATEMENTS, 1))))["Overall"]
    percentages = ["0.0", "0.0", "0.0", "100.0", "0.0"]
    spread = [NOTHING, NOTHING, NOTHING, "1.00", "0.00"]
    assert [cell.text for cell in row[1:]] == [*percentages, "1", "1.00", *spread]


def test_missing_answers_lessen_n_and_percentages_still_sum_to_100():
    found = labelled(table_5(answered({"q1": 2}, {"q1": None, "q2": 1}, {"q1": -1}, {})))
    assert (found["Q1"][6].value, found["Q2"][6].value, found["Q3"][6].value) == (2, 1, 0)
    assert sum(cell.value for cell in found["Q1"][1:6]) == 100.0


def test_every_number_of_table_5_knows_the_sessions_behind_it():
    found = labelled(table_5(answered({"q1": 2, "q2": 1}, {"q1": 1}, {"q2": 2})))
    assert found["Q1"][7].sessions == ("S0", "S1")
    assert found["Q1"][5].sessions == ("S0",)
    assert found["Overall"][5].sessions == ("S0", "S2")


@pytest.mark.parametrize(("rule", "value"), [("first", -2.0), ("last", 2.0), ("all", 0.0)])
def test_rule_of_the_study_decides_which_response_counts(rule, value):
    sessions = [SessionRecord(f"S{n}", "P", "giraff", number=n) for n in (1, 2)]
    dataset = of_drives(sessions, ({"q1": -2}, {"q1": 2}), study=counting(rule))
    found = table_5(replace(dataset, responses=dataset.responses[::-1]))
    assert labelled(found)["Q1"][7].value == value
    assert "response" in found.notes[0]
    assert "1 participant," in found.notes[0]


@pytest.mark.parametrize("rule", ["first", "all"])
def test_participant_is_one_value_of_table_5_however_often_they_answered(rule):
    dataset = answered({"q1": 2}, {"q1": -2}, {"q1": 1}, study=counting(rule))
    responses = (*dataset.responses[:2], replace(dataset.responses[2], participant="P0"))
    found = table_5(replace(dataset, responses=responses))
    row = dict(zip(found.head, labelled(found)["Q1"], strict=True))
    own = [1.5 if rule == "all" else 2.0, -2.0]
    assert row["n"].value == 2
    assert row["Mean"].value == row["Median"].value == pytest.approx(statistics.mean(own))
    assert row["SD"].value == pytest.approx(statistics.stdev(own))
    assert "n: participants who answered at least one of the row's statements" in found.notes[1]


def test_a_response_that_was_not_sent_off_does_not_count():
    dataset = answered({"q1": 2}, {"q1": -2})
    responses = (dataset.responses[0], replace(dataset.responses[1], finished=False))
    assert labelled(table_5(replace(dataset, responses=responses)))["Q1"][7].value == 2.0


def test_in_each_condition_one_response_of_a_participant_counts():
    sessions = [
        SessionRecord("S1", "P", "giraff", condition="alone"),
        SessionRecord("S2", "P", "giraff", number=2, condition="assisted"),
    ]
    dataset = of_drives(sessions, ({"q1": 0}, {"q1": 2}))
    means = [labelled(table_5(dataset, key))["Q1"][7].value for key in (None, "alone", "assisted")]
    assert means == [0.0, 0.0, 2.0]


def test_without_a_questionnaire_tables_are_empty_and_no_error():
    dataset = Dataset(STUDY)
    assert lines_of(dataset) == ([], [])
    for table in (table_1, table_2, table_3, table_4, table_5, participants_table):
        assert as_csv(table(dataset))
        assert as_latex(table(dataset))


def test_table_1_has_a_column_for_each_robot_also_without_a_description():
    dataset = answered({"q1": 1})
    assert table_1(dataset).head == ("", "giraff")
    assert labelled(table_1(DATASET))["RCA"][2].text == "ROS"
    sessions = [cell.value for cell in labelled(table_1(DATASET))["Sessions"][1:]]
    assert sum(sessions) == len(DATASET.sessions)


def test_table_3_has_the_papers_systems_those_that_were_found_and_other():
    devices = ("Windows Chrome", "FreeBSD Firefox", " ", "Windows Opera")
    sessions = tuple(
        SessionRecord(f"S{n}", f"P{n}", "giraff", os=system, browser=browser, network=f"n{n % 2}")
        for n, (system, browser) in enumerate(one.split(" ") for one in devices)
    )
    found = table_3(Dataset(STUDY, sessions=sessions))
    systems = ["Windows", "Linux", "Mac OS", "Android", "iOS", "FreeBSD", "other", "all"]
    assert [row[0].text for row in found.rows] == systems
    assert labelled(found)["Windows"][1].sessions == ("S0",)
    assert labelled(found)["all"][-1].value == 4
    assert "2 different networks" in found.notes[0]
    devices = pandas.DataFrame([(one.os, one.browser) for one in DATASET.sessions])
    counts = pandas.crosstab(devices[0], devices[1])
    assert labelled(table_3(DATASET))["Windows"][1].value == counts.loc["Windows", "Chrome"]


def test_table_4_has_every_statement_with_its_topic():
    found = table_4(DATASET)
    assert [row[1].text for row in found.rows] == [f"Q{n}" for n in range(1, 9)]
    assert found.rows[4][0].text == "Task complexity"
    assert "Strongly disagree" in found.notes[0]


def test_the_answers_of_a_question_and_those_who_gave_none_sum_to_100():
    for table in (table_2(DATASET), participants_table(DATASET)):
        groups, sums = [], {}
        for row in table.rows:
            groups.append(row[0].text or (groups[-1] if groups else ""))
            if row[3].value is not None and row[1].text not in {"youngest", "median", "oldest"}:
                sums[groups[-1]] = sums.get(groups[-1], 0.0) + row[3].value
        sums.pop("Participants", None)
        assert len(sums) >= 7
        assert all(total == pytest.approx(100.0) for total in sums.values())


def test_those_to_whom_a_question_does_not_apply_are_counted_apart():
    asked = [item("single", "s", not_applicable=True), item("single", "t")]
    missing = [{}, {"s": "not_applicable"}, {"s": "skipped"}]
    found = table_2(registered(asked, {"s": "a"}, {}, {}, missing=missing))
    rows = [(row[1].text, row[2].value) for row in found.rows]
    assert ("does not apply", 1) in rows
    assert rows.count(("does not apply", 1)) == 1, "only where it is offered"
    assert ("not reported", 1) in rows
    assert ("not reported", 3) in rows


def test_table_5_treats_does_not_apply_as_missing_and_notes_the_count():
    data = answered({"q1": 2, "q2": 1}, {"q1": 1}, {"q2": 0})
    assert "Does not apply" not in " ".join(table_5(data).notes)
    declined = tuple(
        replace(one, missing={} if "q1" in one.values else {"q1": "not_applicable"})
        for one in data.responses
    )
    table = table_5(replace(data, responses=declined))
    assert table.rows == table_5(data).rows
    assert table.notes[-1] == "Answers “Does not apply”: 1; they count as missing."


def test_of_an_order_is_counted_what_is_first():
    orders = [{"r": list(order)} for order in ("cab", "cba", "abc")]
    found = table_2(registered([item("ranking", "r")], *orders, {}))
    counts = {row[1].text: row[2].value for row in found.rows}
    assert counts == {"A": 1, "B": 0, "C": 2, "not reported": 1}


def test_ages_are_those_of_pandas():
    registered = {one.participant for one in DATASET.responses if one.questionnaire == "ict"}
    ages = pandas.Series([one.age for one in DATASET.participants if one.id in registered])
    found = {row[1].text: row[2].value for row in participants_table(DATASET).rows[:12]}
    assert found["15–29"] == ((ages >= 15) & (ages < 30)).sum()
    assert found["not reported"] == ages.isna().sum()
    ends = (found["youngest"], found["median"], found["oldest"])
    assert ends == (ages.min(), ages.median(), ages.max())


def test_latex_and_csv_survive_what_a_title_can_hold():
    nasty = "50 % of_{x} & #1 \\ ~^ $"
    cells = ((words(nasty), number(-0.001)), (words("=1+1"), number(None)))
    table = Table("t", nasty, ("", "a"), cells, (nasty,))
    latex = r"50 \% of\_\{x\} \& \#1 \textbackslash{} \textasciitilde{}\textasciicircum{} \$"
    assert latex in as_latex(table)
    rows = list(csv.reader(io.StringIO(as_csv(table))))
    assert rows[1] == [nasty, "-0.001"]
    assert rows[2] == ["'=1+1", ""]
    assert number(-0.001).text == "0.00"
    assert number(-1.5).text == "−1.50"
    assert probability(0.0002).text == "<0.001"


def test_a_row_of_the_wrong_length_is_no_table():
    with pytest.raises(ValueError, match="needs 2 cells"):
        Table("t", "", ("a", "b"), ((words("x"),),))
