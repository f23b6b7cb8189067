"""LimeSurvey structures as questionnaires: every type of question, languages, conditions."""

import pytest

from surveys.documents import BadDefinitionError
from surveys.importing.reading import read
from surveys.importing.report import ImportOutcome
from tests.support.studies.survey_files import items, lime, lss, lss_of, outcomes, remarks

PARTS = [("SQ1", "First"), ("SQ2", "Second")]
ANSWERS = [("A1", "Rarely"), ("A2", "Sometimes"), ("A3", "Often")]


def one(letter: str, **more) -> list[dict]:
    return items(lss(lime(letter, "Q1", **more)))


@pytest.mark.parametrize("letter", ["L", "!"])
def test_a_list_is_a_single_choice_by_the_codes_of_its_answers(letter):
    (item,) = one(letter, answers=ANSWERS, mandatory="Y")
    assert (item["kind"], item["key"], item["required"]) == ("single", "q1", True)
    assert [option["value"] for option in item["options"]] == ["a1", "a2", "a3"]


def test_other_is_an_option_with_a_text_and_the_words_of_the_file():
    document = lss(
        lime(
            "L", "Q1", answers=ANSWERS, other="Y", attributes={"other_replace_text": {"en": "Else"}}
        )
    )
    single, text = items(document)
    assert single["options"][-1] == {"value": "other", "label": {"en": "Else"}}
    assert text["show_if"] == {"item": "q1", "is": ["other"]}


def test_a_list_with_a_comment_has_a_text_beside_it():
    assert [item["kind"] for item in one("O", answers=ANSWERS)] == ["single", "text"]


def test_yes_and_no_are_written_in_the_languages_of_the_file():
    document = lss(lime("Y", "Q1"), languages=("de", "en"))
    (item,) = items(document)
    assert [option["label"] for option in item["options"]] == [
        {"de": "Ja", "en": "Yes"},
        {"de": "Nein", "en": "No"},
    ]
    assert outcomes(document)["Q1"] is ImportOutcome.IMPORTED


def test_a_language_without_our_words_for_yes_and_no_is_reported():
    document = lss(lime("Y", "Q1"), languages=("fi",))
    assert items(document)[0]["options"][0]["label"] == {"fi": "Yes"}
    assert "fi" in remarks(document, "Q1")


def test_multiple_choice_has_its_subquestions_as_options():
    (item,) = one(
        "M",
        parts=[*PARTS, ("NONE", "None")],
        attributes={"exclude_all_others": "NONE", "min_answers": "1", "max_answers": "2"},
    )
    assert (item["kind"], item["at_least"], item["at_most"]) == ("multiple", 1, 2)
    assert item["options"][2] == {"value": "none", "label": {"en": "None"}, "alone": True}


def test_multiple_choice_with_comments_has_a_text_for_each_option():
    several, first, second = one("P", parts=PARTS)
    assert [item["show_if"] for item in (first, second)] == [
        {"item": several["key"], "is": ["sq1"]},
        {"item": several["key"], "is": ["sq2"]},
    ]


@pytest.mark.parametrize(("letter", "most"), [("A", 5), ("B", 10)])
def test_arrays_of_numbers_are_grids(letter, most):
    definition = read(lss(lime(letter, "Q1", PARTS))).definition("test", 1)
    (item,) = definition.pages[0].items
    assert [row.key for row in item.rows] == ["q1_sq1", "q1_sq2"]
    assert [point.value for point in definition.scales[item.scale]] == list(range(1, most + 1))


@pytest.mark.parametrize(
    ("letter", "labels"),
    [("C", ["Yes", "Uncertain", "No"]), ("E", ["Increase", "Same", "Decrease"])],
)
def test_arrays_of_words_are_grids_and_their_codes_are_reported(letter, labels):
    document = lss(lime(letter, "Q1", PARTS))
    (points,) = read(document).definition("test", 1).scales.values()
    assert [point.label["en"] for point in points] == labels
    assert "→ 1" in remarks(document, "Q1")


@pytest.mark.parametrize("letter", ["F", "H"])
def test_an_array_is_a_grid_of_its_answers(letter):
    answers = [("1", "Rarely"), ("2", "Sometimes"), ("5", "Often")]
    (points,) = read(lss(lime(letter, "Q1", PARTS, answers))).definition("test", 1).scales.values()
    assert [(point.value, point.label["en"]) for point in points] == [
        *((1, "Rarely"), (2, "Sometimes"), (5, "Often")),
    ]


def test_a_dual_scale_is_two_grids_with_the_headings_of_the_scales():
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


def test_numbers_have_bounds_and_a_unit():
    bounds = {"min_num_value_n": "18", "max_num_value_n": "99", "num_value_int_only": "1"}
    (item,) = one("N", attributes={**bounds, "suffix": {"en": "years"}})
    assert (item["minimum"], item["maximum"], item["whole"], item["unit"]) == (
        *(18, 99, True),
        {"en": "years"},
    )


def test_a_bound_that_is_an_expression_is_reported():
    document = lss(lime("N", "Q1", attributes={"max_num_value_n": "Q0.NAOK + 1"}))
    assert "max_num_value_n" in remarks(document, "Q1")


def test_several_numbers_may_be_sliders_with_words_at_the_ends():
    slider = {"slider_layout": "1", "slider_min": "0", "slider_max": "20", "slider_accuracy": "5"}
    first, second = one("K", parts=[("a", "Pace|slow|fast"), ("b", "Ease")], attributes=slider)
    assert (first["kind"], first["maximum"], first["step"]) == ("slider", 20, 5)
    assert (first["text"]["en"], first["low"]["en"], first["high"]["en"]) == (
        *("Text of Q1 – Pace", "slow", "fast"),
    )
    assert second["low"]["en"] == "0"
    assert [item["kind"] for item in one("K", parts=PARTS)] == ["number", "number"]


def test_texts_days_and_rankings():
    document = lss(
        lime("S", "Q1", attributes={"maximum_chars": "20"}),
        lime("T", "Q2"),
        lime("U", "Q3"),
        lime("Q", "Q4", PARTS),
        lime("D", "Q5", attributes={"date_max": '"now"', "date_min": "2020-01-31"}),
        lime("R", "Q6", (), ANSWERS),
        lime("5", "Q7"),
        lime("G", "Q8"),
    )
    found = {item["key"]: item for item in items(document)}
    assert {key: item["kind"] for key, item in found.items()} == {
        "q1": "text",
        "q2": "text",
        "q3": "text",
        "q4_sq1": "text",
        "q4_sq2": "text",
        "q5": "date",
        "q6": "ranking",
        "q7": "likert",
        "q8": "single",
    }
    assert (found["q1"]["max_length"], found["q2"]["lines"]) == (20, 5)
    assert (found["q5"]["earliest"], found["q5"]["latest"]) == ("2020-01-31", "today")


@pytest.mark.parametrize(
    ("question", "message"),
    [
        (lime("|", "Q1"), "file upload"),
        (lime("*", "Q1"), "equation"),
        (lime("I", "Q1"), "language switch"),
        (lime("?", "Q1"), "type ?"),
        (lime("S", "Q1", attributes={"hidden": "1"}), "hidden"),
        (lime("L", "Q1"), "no options"),
    ],
)
def test_questions_without_counterpart_are_listed(question, message):
    document = lss(question, lime("S", "Q2"))
    assert outcomes(document) == {"Q1": ImportOutcome.LEFT_OUT, "Q2": ImportOutcome.IMPORTED}
    assert message in remarks(document, "Q1")


def test_a_soft_mandatory_question_is_reported():
    document = lss(lime("S", "Q1", mandatory="S"))
    assert "required" not in items(document)[0]
    assert "optional" in remarks(document, "Q1")


# --- groups, languages, the old shape -------------------------------------------------------------


def test_groups_are_pages_with_titles_in_their_order():
    document = lss(lime("S", "Q1", gid=2), lime("S", "Q2", gid=1), groups=("Who", "What"))
    pages = read(document).definition("test", 1).pages
    assert [(page.title["en"], page.items[0].key) for page in pages] == [
        *(("Who", "q2"), ("What", "q1")),
    ]


def test_a_survey_that_shows_one_question_at_a_time_has_a_page_for_each():
    document = lss(lime("S", "Q1"), lime("S", "Q2"), settings={"format": "S"})
    assert len(read(document).definition("test", 1).pages) == 2


def test_the_first_language_is_that_of_the_survey_and_others_are_kept():
    document = lss(
        lime(
            "L",
            "Q1",
            (),
            [("1", {"es": "Sí", "en": "Yes"}), ("2", {"es": "No", "en": "No"})],
            texts={"es": "¿Vale?", "en": "OK?"},
        ),
        languages=("es", "en"),
    )
    definition = read(document).definition("test", 1)
    assert definition.languages == ("es", "en")
    assert definition.title == {"es": "Survey in es", "en": "Survey in en"}
    (item,) = definition.pages[0].items
    assert item.text == {"es": "¿Vale?", "en": "OK?"}
    assert item.options[0].label == {"es": "Sí", "en": "Yes"}


def test_a_structure_of_version_3_has_its_texts_in_a_row_for_each_language():
    def rows(**texts: str) -> list[dict]:
        common = {"qid": 1, "parent_qid": 0, "gid": 1, "type": "L", "title": "Q1"}
        return [
            {**common, "question": text, "help": "", "mandatory": "Y", "language": lang}
            for lang, text in texts.items()
        ]

    document = lss_of(
        {
            "groups": [
                {"gid": 1, "group_name": name, "group_order": 0, "language": lang}
                for lang, name in (("en", "One"), ("fr", "Un"))
            ],
            "questions": rows(en="How?", fr="Comment ?"),
            "answers": [
                {"qid": 1, "code": code, "answer": text, "sortorder": n, "language": lang}
                for n, (code, words) in enumerate(
                    [("A1", {"en": "Well", "fr": "Bien"}), ("A2", {"en": "Badly", "fr": "Mal"})]
                )
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
    (page,) = read(document).definition("test", 1).pages
    assert page.intro["en"] == "Text of Q1"
    assert outcomes(document)["Q3"] is ImportOutcome.LEFT_OUT


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
def test_a_relevance_that_compares_answers_is_a_condition(relevance, condition):
    document = lss(
        lime("L", "Q1", (), ANSWERS),
        lime("M", "Q2", PARTS),
        lime("A", "Q3", PARTS),
        lime("S", "Q4", relevance=relevance),
    )
    assert items(document)[-1]["show_if"] == condition
    assert outcomes(document)["Q4"] is ImportOutcome.IMPORTED


@pytest.mark.parametrize(
    "relevance",
    ['Q1 != "A1"', 'Q1 == "A1" and Q1 == "A2"', "count(self) > 1", 'Q9 == "A1"', 'Q2 == "A1"'],
)
def test_any_other_relevance_is_reported_as_written(relevance):
    document = lss(lime("L", "Q1", (), ANSWERS), lime("S", "Q2", relevance=relevance))
    assert "show_if" not in items(document)[-1]
    assert relevance in remarks(document, "Q2")


def test_quotas_end_texts_and_filters_are_reported():
    quota = "<quota><rows><row><id>1</id></row></rows></quota>"
    document = lss(lime("M", "Q1", PARTS, attributes={"array_filter": "Q0"}), more=quota)
    assert outcomes(document)["quotas"] is ImportOutcome.LEFT_OUT
    assert "array filter" in remarks(document, "Q1")


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
