"""LimeSurvey structures: remarks on parts that are changed or left out, and odd files."""

import pytest

from surveys.documents import MAX_TEXT
from surveys.importing.reading import read
from surveys.importing.report import ImportOutcome
from tests.support.studies.survey_files import items, lime, lss, lss_of, outcomes, remarks
from tests.unit.surveys.importing.test_lss import ANSWERS, PARTS

FIRST = {"qid": 1, "parent_qid": 0, "gid": 1, "type": "S", "title": "Q1", "question_order": 2}


def with_texts(**texts: str) -> dict[str, list[dict]]:
    """Return the tables of a survey with one question and these texts of its own."""
    return {
        "groups": [{"gid": 1, "group_order": 0}],
        "group_l10ns": [{"gid": 1, "group_name": "One", "language": "en"}],
        "questions": [FIRST],
        "question_l10ns": [{"qid": 1, "question": "How?", "language": "en"}],
        "surveys": [{"sid": 9, "language": "en"}],
        "surveys_languagesettings": [{"surveyls_language": "en", **texts}],
    }


# --- numbers that are none ------------------------------------------------------------------------


@pytest.mark.parametrize("odd", ["nan", "inf", "-inf", "1e999", "9" * 400])
@pytest.mark.parametrize(
    ("letter", "attribute"),
    [
        ("K", "slider_min"),
        ("K", "slider_max"),
        ("K", "slider_accuracy"),
        ("M", "min_answers"),
        ("M", "max_answers"),
        ("N", "max_num_value_n"),
    ],
)
def test_a_bound_that_is_no_finite_number_is_reported_and_the_question_is_asked(
    letter, attribute, odd
):
    attributes = {"slider_layout": "1", attribute: odd}
    document = lss(lime(letter, "Q1", PARTS, attributes=attributes))
    assert items(document)
    assert f"{attribute} = {odd[:20]}" in remarks(document, "Q1")


def test_a_bound_that_no_slider_can_have_leaves_the_question_out():
    sliders = {"slider_layout": "1", "slider_max": "1e300"}
    document = lss(lime("K", "Q1", PARTS, attributes=sliders), lime("S", "Q2"))
    assert outcomes(document) == {"Q1": ImportOutcome.LEFT_OUT, "Q2": ImportOutcome.IMPORTED}


# --- languages ------------------------------------------------------------------------------------


def test_a_language_with_capitals_keeps_its_texts_and_those_of_its_attributes():
    words = {"pt-BR": "Outra coisa", "en": "Else"}
    question = lime(
        *("L", "Q1", (), [("1", {"pt-BR": "Sim", "en": "Yes"})]),
        attributes={"other_replace_text": words},
        texts={"pt-BR": "Tudo bem?", "en": "OK?"},
        other="Y",
    )
    single, text = items(lss(question, languages=("pt-BR", "en")))
    assert single["text"] == {"pt-br": "Tudo bem?", "en": "OK?"}
    assert single["options"][0]["label"] == {"pt-br": "Sim", "en": "Yes"}
    assert text["text"] == {"pt-br": "Outra coisa", "en": "Else"}


# --- the survey and its groups --------------------------------------------------------------------


def test_a_description_and_a_welcome_text_that_are_too_long_together_are_shortened():
    texts = with_texts(surveyls_description="d" * 3000, surveyls_welcometext="w" * 3000)
    document = lss_of(texts)
    intro = read(document).definition("test", 1).intro["en"]
    assert (len(intro), intro[:1], intro[-1:]) == (MAX_TEXT, "d", "w")
    assert "shortened" in remarks(document, "Welcome text")


def test_a_title_that_is_too_long_is_shortened():
    definition = read(lss_of(with_texts(surveyls_title="t" * 300))).definition("test", 1)
    assert definition.title["en"] == "t" * 200


def test_end_texts_are_reported_once_and_empty_ones_not():
    document = lss_of(with_texts(surveyls_endtext="Thank you", surveyls_policy_notice=" "))
    assert outcomes(document) == {
        "Q1": ImportOutcome.IMPORTED,
        "surveyls_endtext": ImportOutcome.LEFT_OUT,
    }


def test_default_answers_are_reported():
    document = lss_of(with_texts() | {"defaultvalues": [{"qid": 1, "defaultvalue": "x"}]})
    assert "preselected" in remarks(document, "default values")


def test_a_group_with_a_condition_and_a_random_order_is_a_page_with_that_condition():
    tables = with_texts() | {
        "groups": [
            {"gid": 1, "group_order": 0},
            {"gid": 2, "group_order": 1, "randomization_group": "r", "grelevance": 'Q1 == "a"'},
        ],
        "group_l10ns": [
            {"gid": gid, "group_name": name, "language": "en"}
            for gid, name in ((1, "One"), (2, "Two"))
        ],
        "questions": [
            FIRST | {"type": "L"},
            {**FIRST, "qid": 2, "gid": 2, "title": "Q2"},
        ],
        "answers": [{"qid": 1, "code": "a", "answer": "A", "language": "en", "sortorder": "x"}],
    }
    document = lss_of(tables)
    pages = read(document).definition("test", 1).pages
    assert [page.items[0].key for page in pages] == ["q1", "q2"]
    assert (pages[1].show_if.item, pages[1].show_if.one_of) == ("q1", ("a",))
    assert "random order of groups" in remarks(document, "Group: Two")


def test_orphan_rows_are_left_out_and_an_order_without_a_number_is_first():
    tables = with_texts() | {
        "questions": [FIRST, {**FIRST, "qid": 2, "title": "Q2", "question_order": "first"}],
        "question_attributes": [{"qid": 99, "attribute": "hidden", "value": "1"}],
        "answers": [{"qid": 99, "code": "a", "answer": "A", "language": "en"}],
        "question_l10ns": [
            {"qid": qid, "question": "How?", "language": "en"} for qid in (1, 2, 99)
        ],
    }
    assert [item["key"] for item in items(lss_of(tables))] == ["q2", "q1"]


# --- questions ------------------------------------------------------------------------------------


def test_an_array_of_more_than_eleven_answers_is_a_list_of_options_for_each_row():
    answers = [(f"A{n}", f"Answer {n}") for n in range(12)]
    document = lss(lime("F", "Q1", PARTS, answers))
    assert [(one["kind"], len(one["options"])) for one in items(document)] == [("single", 12)] * 2
    assert "at most 11 points" in remarks(document, "Q1")


def test_arrays_with_the_same_answers_share_a_scale():
    answers = [("1", "Rarely"), ("2", "Often")]
    document = lss(lime("F", "Q1", PARTS, answers), lime("F", "Q2", PARTS, answers))
    assert len(read(document).definition("test", 1).scales) == 1


def test_other_of_a_multiple_choice_has_a_text():
    several, text = items(lss(lime("M", "Q1", PARTS, other="Y")))
    assert several["options"][-1] == {"value": "other", "label": {"en": "Other"}}
    assert text["show_if"] == {"item": "q1", "is": ["other"]}


def test_codes_that_become_alike_are_changed_and_reported():
    document = lss(lime("L", "Q1", (), [("A 1", "One"), ("A_1", "Two")]))
    assert [one["value"] for one in items(document)[0]["options"]] == ["a_1", "a_1_2"]
    assert "A_1 → a_1_2" in remarks(document, "Q1")


def test_a_condition_on_an_option_without_a_text_is_reported():
    document = lss(
        lime("L", "Q1", (), [("A1", "One"), ("A2", "")]), lime("S", "Q2", relevance="Q1 == 'A2'")
    )
    assert "A2" in remarks(document, "Q1")
    assert "shown to everybody" in remarks(document, "Q2")


def test_a_condition_on_a_question_that_was_left_out_is_reported():
    document = lss(
        lime("M", "Q1", [("a", "A")], attributes={"min_answers": "3"}),
        lime("S", "Q2", relevance="Q1_a == 'Y'"),
    )
    assert outcomes(document)["Q1"] is ImportOutcome.LEFT_OUT
    assert "shown to everybody" in remarks(document, "Q2")
    assert "show_if" not in items(document)[-1]


@pytest.mark.parametrize(
    ("question", "message"),
    [
        (lime("R", "Q1", (), ANSWERS, {"max_answers": "2"}), "rank all options"),
        (lime("R", "Q1", (), ANSWERS, {"max_subquestions": "2"}), "rank all options"),
        (lime("N", "Q1", attributes={"prefix": {"en": "about"}}), "before the number"),
        (lime("K", "Q1", PARTS, (), {"equals_num_value": "100"}), "equals_num_value = 100"),
        (
            lime("K", "Q1", PARTS, (), {"slider_layout": "1", "slider_accuracy": "0.5"}),
            "only whole numbers",
        ),
        (lime("D", "Q1", attributes={"date_format": "yyyy-mm-dd HH:MM"}), "not the time"),
        (lime("D", "Q1", attributes={"date_min": "next week"}), "date_min"),
        (lime("S", "Q1", texts=" "), "its name is shown"),
        (lime("L", "Q1", (), ANSWERS, {"answer_order": "alphabetical"}), "(alphabetical)"),
        (lime("S", "Q1", preg="/x/"), "validation"),
        (lime("S", "Q1", attributes={"em_validation_q": "x > 1"}), "validation"),
    ],
)
def test_differences_from_the_file_are_reported(question, message):
    document = lss(question)
    assert items(document)
    assert message in remarks(document, "Q1")


def test_a_text_that_takes_only_numbers_is_a_number():
    (item,) = items(
        lss(lime("S", "Q1", attributes={"numbers_only": "1", "num_value_int_only": "1"}))
    )
    assert (item["kind"], item["whole"]) == ("number", True)


@pytest.mark.parametrize("attributes", [{"random_order": "1"}, {"answer_order": "random"}])
def test_a_random_order_of_answers_is_kept(attributes):
    (item,) = items(lss(lime("L", "Q1", (), ANSWERS, attributes)))
    assert item["order"] == "shuffled"


def test_the_condition_of_a_text_display_is_reported():
    document = lss(
        lime("L", "Q0", (), ANSWERS), lime("X", "Q1", relevance='Q0 == "A1"'), lime("S", "Q2")
    )
    assert "shown to everybody" in remarks(document, "Q1")


def test_a_text_display_that_does_not_fit_on_its_page_is_shortened():
    document = lss(
        *(lime("X", f"Q{n}", texts="x" * 3000) for n in (1, 2)),
        lime("S", "Q3"),
    )
    (page,) = read(document).definition("test", 1).pages
    assert len(page.intro["en"]) == MAX_TEXT
    assert "shortened" in remarks(document, "Q2")


def test_conditions_of_single_options_and_scores_are_reported():
    tables = with_texts() | {
        "questions": [FIRST | {"type": "L"}],
        "subquestions": [
            {**FIRST, "qid": 5, "parent_qid": 1, "title": "a", "relevance": "Q0 == 1"}
        ],
        "answers": [
            {"qid": 1, "code": code, "answer": code, "language": "en", "assessment_value": score}
            for code, score in (("a", "0"), ("b", "3"))
        ],
        "surveys": [{"sid": 9, "language": "en", "assessments": "Y"}],
    }
    found = remarks(lss_of(tables), "Q1")
    assert "Conditions of single options" in found
    assert "scores are not imported" in found
