"""LimeSurvey structures: every type of question, remarks, conditions, and malformed files."""

import pytest

from surveys.documents import MAX_TEXT, BadDefinitionError
from surveys.importing.reading import read
from surveys.importing.report import ImportOutcome
from tests.support.studies.survey_files import (
    definition_of,
    items,
    lime,
    lss,
    lss_of,
    outcomes,
    points_of,
    remarks,
)

LEFT_OUT, IMPORTED = ImportOutcome.LEFT_OUT, ImportOutcome.IMPORTED
PARTS = [("SQ1", "First"), ("SQ2", "Second")]
ANSWERS = [("A1", "Rarely"), ("A2", "Sometimes"), ("A3", "Often")]


def one(kind: str, **more) -> list[dict]:
    return items(lss(lime(kind, "Q1", **more)))


WHOLE = {"num_value_int_only": "1"}


@pytest.mark.parametrize(
    ("question", "expected"),
    [
        pytest.param(
            lime(kind, "Q1", (), ANSWERS, mandatory="Y"),
            {"kind": "single", "key": "q1", "required": True},
            id=name,
        )
        for kind, name in (("L", "list"), ("!", "drop-down list"))
    ]
    + [
        pytest.param(
            lime("S", "Q1", attributes={"maximum_chars": "20"}),
            {"kind": "text", "max_length": 20},
            id="short text",
        ),
        pytest.param(lime("T", "Q1"), {"kind": "text", "lines": 5}, id="long text"),
        pytest.param(lime("U", "Q1"), {"kind": "text"}, id="huge text"),
        pytest.param(lime("Q", "Q1", PARTS[:1]), {"kind": "text", "key": "q1_sq1"}, id="texts"),
        pytest.param(
            lime("D", "Q1", attributes={"date_max": '"now"', "date_min": "2020-01-31"}),
            {"kind": "date", "earliest": "2020-01-31", "latest": "today"},
            id="date",
        ),
        pytest.param(lime("R", "Q1", (), ANSWERS), {"kind": "ranking"}, id="ranking"),
        pytest.param(lime("5", "Q1"), {"kind": "likert"}, id="five points"),
        pytest.param(lime("G", "Q1"), {"kind": "single"}, id="gender"),
        pytest.param(
            lime(
                *("N", "Q1"),
                attributes=WHOLE
                | {"min_num_value_n": "18", "max_num_value_n": "99", "suffix": {"en": "years"}},
            ),
            {
                "kind": "number",
                "minimum": 18,
                "maximum": 99,
                "whole": True,
                "unit": {"en": "years"},
            },
            id="number",
        ),
        pytest.param(
            lime("S", "Q1", attributes=WHOLE | {"numbers_only": "1"}),
            {"kind": "number", "whole": True},
            id="text of digits",
        ),
        pytest.param(
            lime("M", "Q1", PARTS, attributes={"min_answers": "1", "max_answers": "2"}),
            {"kind": "multiple", "at_least": 1, "at_most": 2},
            id="multiple choice",
        ),
        pytest.param(
            lime("L", "Q1", (), ANSWERS, {"random_order": "1"}),
            {"order": "shuffled"},
            id="random order",
        ),
        pytest.param(
            lime("L", "Q1", (), ANSWERS, {"answer_order": "random"}),
            {"order": "shuffled"},
            id="random order of version 6",
        ),
    ],
)
def test_question_becomes_one_question_of_its_kind(question, expected):
    (item,) = items(lss(question))
    assert item | expected == item


def test_options_of_a_list_have_the_codes_of_its_answers():
    (item,) = one("L", answers=ANSWERS)
    assert [option["value"] for option in item["options"]] == ["a1", "a2", "a3"]


@pytest.mark.parametrize(
    ("question", "words"),
    [
        (lime("L", "Q1", (), ANSWERS, {"other_replace_text": {"en": "Else"}}, other="Y"), "Else"),
        (lime("M", "Q1", PARTS, other="Y"), "Other"),
    ],
)
def test_other_is_an_option_with_a_text(question, words):
    asked, text = items(lss(question))
    assert asked["options"][-1] == {"value": "other", "label": {"en": words}}
    assert text["show_if"] == {"item": "q1", "is": ["other"]}


def test_list_with_a_comment_has_a_text_beside_it():
    assert [item["kind"] for item in one("O", answers=ANSWERS)] == ["single", "text"]


def test_yes_and_no_are_written_in_the_languages_of_the_file():
    document = lss(lime("Y", "Q1"), languages=("de", "en"))
    (item,) = items(document)
    assert [option["label"] for option in item["options"]] == [
        {"de": "Ja", "en": "Yes"},
        {"de": "Nein", "en": "No"},
    ]
    assert outcomes(document)["Q1"] is IMPORTED


def test_language_without_our_words_for_yes_and_no_is_reported():
    document = lss(lime("Y", "Q1"), languages=("fi",))
    assert items(document)[0]["options"][0]["label"] == {"fi": "Yes"}
    assert "fi" in remarks(document, "Q1")


def test_option_of_a_multiple_choice_can_exclude_the_others():
    (item,) = one("M", parts=[*PARTS, ("NONE", "None")], attributes={"exclude_all_others": "NONE"})
    assert item["options"][2] == {"value": "none", "label": {"en": "None"}, "alone": True}


def test_multiple_choice_with_comments_has_a_text_for_each_option():
    several, first, second = one("P", parts=PARTS)
    assert [item["show_if"] for item in (first, second)] == [
        {"item": several["key"], "is": ["sq1"]},
        {"item": several["key"], "is": ["sq2"]},
    ]


@pytest.mark.parametrize(
    ("kind", "labels"),
    [
        ("A", [str(n + 1) for n in range(5)]),
        ("B", [str(n + 1) for n in range(10)]),
        ("C", ["Yes", "Uncertain", "No"]),
        ("E", ["Increase", "Same", "Decrease"]),
        ("F", ["Rarely", "Sometimes", "Often"]),
        ("H", ["Rarely", "Sometimes", "Often"]),
    ],
)
def test_array_is_a_grid_whose_points_are_numbered_from_1(kind, labels):
    document = lss(lime(kind, "Q1", PARTS, ANSWERS if kind in "FH" else ()))
    (grid,) = items(document)
    assert [row["key"] for row in grid["rows"]] == ["q1_sq1", "q1_sq2"]
    points = points_of(document)
    assert [point.value for point in points] == list(range(1, len(labels) + 1))
    assert [point.label.get("en", str(point.value)) for point in points] == labels
    if kind in "CE":
        assert "→ 1" in remarks(document, "Q1")


def test_numeric_codes_of_the_answers_of_an_array_are_kept():
    answers = [("1", "Rarely"), ("2", "Sometimes"), ("5", "Often")]
    points = points_of(lss(lime("F", "Q1", PARTS, answers)))
    assert [(point.value, point.label["en"]) for point in points] == [
        *((1, "Rarely"), (2, "Sometimes"), (5, "Often")),
    ]


def test_array_of_more_than_eleven_answers_is_a_list_of_options_for_each_row():
    document = lss(lime("F", "Q1", PARTS, [(f"A{n}", f"Answer {n}") for n in range(12)]))
    assert [(one["kind"], len(one["options"])) for one in items(document)] == [("single", 12)] * 2
    assert "at most 11 points" in remarks(document, "Q1")


def test_arrays_with_the_same_answers_share_a_scale():
    answers = [("1", "Rarely"), ("2", "Often")]
    assert points_of(lss(*(lime("F", name, PARTS, answers) for name in ("Q1", "Q2"))))


def test_dual_scale_is_two_grids_with_the_headings_of_the_scales():
    answers = [("1", "low", 0), ("2", "high", 0), ("1", "never", 1), ("2", "ever", 1)]
    heads = {"dualscale_headerA": {"en": "Trust"}, "dualscale_headerB": {"en": "Use"}}
    first, second = one("1", parts=PARTS, answers=answers, attributes=heads)
    assert (first["text"]["en"], second["text"]["en"]) == ("Text of Q1 – Trust", "Text of Q1 – Use")
    assert [row["key"] for row in second["rows"]] == ["q1_sq1_1", "q1_sq2_1"]


def test_arrays_of_numbers_and_texts_are_a_question_for_each_cell():
    cells = [("R1", "Row 1", 0), ("R2", "Row 2", 0), ("C1", "Column 1", 1), ("C2", "Column 2", 1)]
    found = one(":", parts=cells, attributes={"multiflexible_max": "9"})
    assert [item["key"] for item in found] == ["q1_r1_c1", "q1_r1_c2", "q1_r2_c1", "q1_r2_c2"]
    assert (found[0]["kind"], found[0]["maximum"]) == ("number", 9)
    assert found[3]["text"]["en"] == "Text of Q1 – Row 2 – Column 2"
    assert {item["kind"] for item in one(";", parts=cells)} == {"text"}
    ticks = one(":", parts=cells, attributes={"multiflexible_checkbox": "1"})
    assert [item["kind"] for item in ticks] == ["multiple", "multiple"]


def test_several_numbers_may_be_sliders_with_words_at_the_ends():
    slider = {"slider_layout": "1", "slider_min": "0", "slider_max": "20", "slider_accuracy": "5"}
    first, second = one("K", parts=[("a", "Pace|slow|fast"), ("b", "Ease")], attributes=slider)
    assert (first["kind"], first["maximum"], first["step"]) == ("slider", 20, 5)
    words = [first[name]["en"] for name in ("text", "low", "high")]
    assert words == ["Text of Q1 – Pace", "slow", "fast"]
    assert second["low"]["en"] == "0"
    assert [item["kind"] for item in one("K", parts=PARTS)] == ["number", "number"]


def test_codes_that_become_alike_are_changed_and_reported():
    document = lss(lime("L", "Q1", (), [("A 1", "One"), ("A_1", "Two")]))
    assert [one["value"] for one in items(document)[0]["options"]] == ["a_1", "a_1_2"]
    assert "A_1 → a_1_2" in remarks(document, "Q1")


@pytest.mark.parametrize(
    ("question", "message"),
    [
        (lime("|", "Q1"), "file upload"),
        (lime("*", "Q1"), "equation"),
        (lime("I", "Q1"), "language switch"),
        (lime("?", "Q1"), "type ?"),
        (lime("S", "Q1", attributes={"hidden": "1"}), "hidden"),
        (lime("L", "Q1"), "no options"),
        (lime("K", "Q1", PARTS, (), {"slider_layout": "1", "slider_max": "1e300"}), ""),
    ],
)
def test_question_without_a_counterpart_is_listed(question, message):
    document = lss(question, lime("S", "Q2"))
    assert outcomes(document) == {"Q1": LEFT_OUT, "Q2": IMPORTED}
    assert message in remarks(document, "Q1")


@pytest.mark.parametrize(
    ("question", "message"),
    [
        (lime("S", "Q1", mandatory="S"), "optional"),
        (lime("N", "Q1", attributes={"max_num_value_n": "Q0.NAOK + 1"}), "max_num_value_n"),
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
        (lime("M", "Q1", PARTS, attributes={"array_filter": "Q0"}), "array filter"),
    ],
)
def test_differences_from_the_file_are_reported(question, message):
    document = lss(question)
    assert "required" not in items(document)[0]
    assert message in remarks(document, "Q1")


@pytest.mark.parametrize("odd", ["nan", "inf", "-inf", "1e999", "9" * 400])
@pytest.mark.parametrize(
    ("kind", "attribute"),
    [
        ("K", "slider_min"),
        ("K", "slider_max"),
        ("K", "slider_accuracy"),
        ("M", "min_answers"),
        ("M", "max_answers"),
        ("N", "max_num_value_n"),
    ],
)
def test_bound_that_is_not_finite_is_reported_and_the_question_is_asked(kind, attribute, odd):
    attributes = {"slider_layout": "1", attribute: odd}
    document = lss(lime(kind, "Q1", PARTS, attributes=attributes))
    assert items(document)
    assert f"{attribute} = {odd[:20]}" in remarks(document, "Q1")


# --- groups, languages, the old shape -------------------------------------------------------------


def test_groups_are_pages_with_titles_in_their_order():
    document = lss(lime("S", "Q1", gid=2), lime("S", "Q2", gid=1), groups=("Who", "What"))
    pages = definition_of(document).pages
    assert [(page.title["en"], page.items[0].key) for page in pages] == [
        *(("Who", "q2"), ("What", "q1")),
    ]


def test_survey_that_shows_one_question_at_a_time_has_a_page_for_each():
    document = lss(lime("S", "Q1"), lime("S", "Q2"), settings={"format": "S"})
    assert len(definition_of(document).pages) == 2


def test_languages_keep_their_texts_and_the_survey_names_the_first():
    question = lime(
        *("L", "Q1", (), [("1", {"pt-BR": "Sim", "en": "Yes"})]),
        attributes={"other_replace_text": {"pt-BR": "Outra coisa", "en": "Else"}},
        texts={"pt-BR": "Tudo bem?", "en": "OK?"},
        other="Y",
    )
    definition = definition_of(lss(question, languages=("pt-BR", "en")))
    assert definition.languages == ("pt-br", "en")
    assert definition.title == {"pt-br": "Survey in pt-BR", "en": "Survey in en"}
    single, text = definition.pages[0].items
    assert single.text == {"pt-br": "Tudo bem?", "en": "OK?"}
    assert single.options[0].label == {"pt-br": "Sim", "en": "Yes"}
    assert text.text == {"pt-br": "Outra coisa", "en": "Else"}


def test_structure_of_version_3_has_its_texts_in_a_row_for_each_language():
    question = {"qid": 1, "parent_qid": 0, "gid": 1, "type": "L", "title": "Q1", "mandatory": "Y"}
    answers = [("A1", {"en": "Well", "fr": "Bien"}), ("A2", {"en": "Badly", "fr": "Mal"})]
    document = lss_of(
        {
            "groups": [
                {"gid": 1, "group_name": name, "group_order": 0, "language": lang}
                for lang, name in (("en", "One"), ("fr", "Un"))
            ],
            "questions": [
                question | {"question": text, "help": "", "language": lang}
                for lang, text in (("en", "How?"), ("fr", "Comment ?"))
            ],
            "answers": [
                {"qid": 1, "code": code, "answer": text, "sortorder": n, "language": lang}
                for n, (code, words) in enumerate(answers)
                for lang, text in words.items()
            ],
            "surveys": [{"sid": 9, "language": "en", "additional_languages": "fr"}],
        },
        languages=("en", "fr"),
        version=264,
    )
    (item,) = items(document)
    assert item["text"] == {"en": "How?", "fr": "Comment ?"}
    assert item["options"][1]["label"] == {"en": "Badly", "fr": "Mal"}
    assert item["required"] is True


def test_text_display_introduces_a_page():
    document = lss(lime("X", "Q1"), lime("S", "Q2"), lime("X", "Q3"))
    (page,) = definition_of(document).pages
    assert page.intro["en"] == "Text of Q1"
    assert outcomes(document)["Q3"] is LEFT_OUT


def test_text_display_that_does_not_fit_on_its_page_is_shortened():
    displays = [lime("X", f"Q{n}", texts="x" * 3000) for n in (1, 2)]
    document = lss(*displays, lime("S", "Q3"))
    (page,) = definition_of(document).pages
    assert len(page.intro["en"]) == MAX_TEXT
    assert "shortened" in remarks(document, "Q2")


# --- the survey and its groups --------------------------------------------------------------------

FIRST = {"qid": 1, "parent_qid": 0, "gid": 1, "type": "S", "title": "Q1", "question_order": 2}


def tables(**texts: str) -> dict[str, list[dict]]:
    """Return the tables of a survey with one question and these texts of its own."""
    return {
        "groups": [{"gid": 1, "group_order": 0}],
        "group_l10ns": [{"gid": 1, "group_name": "One", "language": "en"}],
        "questions": [FIRST],
        "question_l10ns": [{"qid": 1, "question": "How?", "language": "en"}],
        "surveys": [{"sid": 9, "language": "en"}],
        "surveys_languagesettings": [{"surveyls_language": "en", **texts}],
    }


def test_description_and_welcome_text_that_are_too_long_together_are_shortened():
    texts = {"surveyls_description": "d" * 3000, "surveyls_welcometext": "w" * 3000}
    document = lss_of(tables(**texts, surveyls_title="t" * 300))
    definition = definition_of(document)
    intro = definition.intro["en"]
    assert (len(intro), intro[:1], intro[-1:]) == (MAX_TEXT, "d", "w")
    assert "shortened" in remarks(document, "Welcome text")
    assert definition.title["en"] == "t" * 200


def test_end_texts_are_reported_unless_they_are_empty():
    document = lss_of(tables(surveyls_endtext="Thank you", surveyls_policy_notice=" "))
    assert outcomes(document) == {"Q1": IMPORTED, "surveyls_endtext": LEFT_OUT}


def test_quotas_and_default_answers_are_reported():
    quota = "<quota><rows><row><id>1</id></row></rows></quota>"
    defaults = {"defaultvalues": [{"qid": 1, "defaultvalue": "x"}]}
    document = lss_of(tables() | defaults, more=quota)
    assert outcomes(document)["quotas"] is LEFT_OUT
    assert "preselected" in remarks(document, "default values")


def test_group_with_a_condition_and_a_random_order_is_a_page_with_that_condition():
    group = {"gid": 2, "randomization_group": "r", "grelevance": 'Q1 == "a"'}
    document = lss_of(
        tables()
        | {
            "groups": [{"gid": 1, "group_order": 0}, group | {"group_order": 1}],
            "group_l10ns": [
                {"gid": gid, "group_name": name, "language": "en"}
                for gid, name in ((1, "One"), (2, "Two"))
            ],
            "questions": [FIRST | {"type": "L"}, FIRST | {"qid": 2, "gid": 2, "title": "Q2"}],
            "answers": [{"qid": 1, "code": "a", "answer": "A", "language": "en", "sortorder": "x"}],
        }
    )
    first, second = definition_of(document).pages
    assert [page.items[0].key for page in (first, second)] == ["q1", "q2"]
    assert (second.show_if.item, second.show_if.one_of) == ("q1", ("a",))
    assert "random order of groups" in remarks(document, "Group: Two")


def test_orphan_rows_are_left_out_and_an_order_without_a_number_is_first():
    rows = {
        "questions": [FIRST, {**FIRST, "qid": 2, "title": "Q2", "question_order": "first"}],
        "question_attributes": [{"qid": 99, "attribute": "hidden", "value": "1"}],
        "answers": [{"qid": 99, "code": "a", "answer": "A", "language": "en"}],
        "question_l10ns": [
            {"qid": qid, "question": "How?", "language": "en"} for qid in (1, 2, 99)
        ],
    }
    assert [item["key"] for item in items(lss_of(tables() | rows))] == ["q2", "q1"]


def test_conditions_of_single_options_and_scores_are_reported():
    part = {**FIRST, "qid": 5, "parent_qid": 1, "title": "a", "relevance": "Q0 == 1"}
    rows = {
        "questions": [FIRST | {"type": "L"}],
        "subquestions": [part],
        "answers": [
            {"qid": 1, "code": code, "answer": code, "language": "en", "assessment_value": score}
            for code, score in (("a", "0"), ("b", "3"))
        ],
        "surveys": [{"sid": 9, "language": "en", "assessments": "Y"}],
    }
    found = remarks(lss_of(tables() | rows), "Q1")
    assert "Conditions of single options" in found
    assert "scores are not imported" in found


# --- conditions -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("relevance", "condition"),
    [
        ('Q1.NAOK == "A1"', {"item": "q1", "is": ["a1"]}),
        ('((Q1.NAOK == "A1") or (Q1.NAOK == "A2"))', {"item": "q1", "is": ["a1", "a2"]}),
        ("Q2_SQ1.NAOK == 'Y'", {"item": "q2", "is": ["sq1"]}),
        ("Q3_SQ2 == 4", {"item": "q3_sq2", "is": [4]}),
    ],
)
def test_relevance_that_compares_answers_is_a_condition(relevance, condition):
    document = lss(
        lime("L", "Q1", (), ANSWERS),
        lime("M", "Q2", PARTS),
        lime("A", "Q3", PARTS),
        lime("S", "Q4", relevance=relevance),
    )
    assert items(document)[-1]["show_if"] == condition
    assert outcomes(document)["Q4"] is IMPORTED


@pytest.mark.parametrize(
    "relevance",
    ['Q1 != "A1"', 'Q1 == "A1" and Q1 == "A2"', "count(self) > 1", 'Q9 == "A1"', 'Q2 == "A1"'],
)
def test_any_other_relevance_is_reported_as_written(relevance):
    document = lss(lime("L", "Q1", (), ANSWERS), lime("S", "Q2", relevance=relevance))
    assert "show_if" not in items(document)[-1]
    assert relevance in remarks(document, "Q2")


@pytest.mark.parametrize(
    "questions",
    [
        pytest.param(
            [lime("L", "Q1", (), [*ANSWERS, ("A4", "")]), lime("S", "Q2", relevance="Q1 == 'A4'")],
            id="on an option without a text",
        ),
        pytest.param(
            [
                lime("M", "Q1", [("a", "A")], attributes={"min_answers": "3"}),
                lime("S", "Q2", relevance="Q1_a == 'Y'"),
            ],
            id="on a question that is left out",
        ),
        pytest.param(
            [
                lime("L", "Q1", (), ANSWERS),
                lime("X", "Q2", relevance='Q1 == "A1"'),
                lime("S", "Q3"),
            ],
            id="of a text display",
        ),
    ],
)
def test_condition_that_cannot_be_kept_is_reported(questions):
    document = lss(*questions)
    assert "show_if" not in items(document)[-1]
    assert "shown to everybody" in remarks(document, "Q2")


# --- malformed and hostile files ------------------------------------------------------------------

BOMB = (
    '<?xml version="1.0"?><!DOCTYPE d [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;">]>'
    "<document><LimeSurveyDocType>&b;</LimeSurveyDocType></document>"
)
OUTSIDE = (
    '<?xml version="1.0"?><!DOCTYPE d [<!ENTITY x SYSTEM "file:///etc/passwd">]>'
    "<document><LimeSurveyDocType>&x;</LimeSurveyDocType></document>"
)


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (BOMB.encode(), "document type"),
        (OUTSIDE.encode(), "document type"),
        (b"<document><a>", "not valid XML"),
        (b"<document>\xff\xfe</document>", "not valid XML"),
        (b"<a>" * 60 + b"</a>" * 60, "nested too deeply"),
        (b"<html></html>", "not a LimeSurvey survey structure"),
        (b"<document><LimeSurveyDocType>Group</LimeSurveyDocType></document>", "Group"),
        (b"<document>&undefined;</document>", "not valid XML"),
    ],
)
def test_hostile_and_malformed_xml_is_refused_with_a_clear_message(document, message):
    with pytest.raises(BadDefinitionError, match=message):
        read(document)
