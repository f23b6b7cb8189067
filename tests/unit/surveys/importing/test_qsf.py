"""Qualtrics files as questionnaires: what each kind of question becomes, and its remarks."""

import pytest

from surveys.documents import BadDefinitionError
from surveys.importing.draft import Draft
from surveys.importing.reading import read
from surveys.importing.report import ImportOutcome
from tests.support.studies.survey_files import (
    displays,
    forced,
    items,
    outcomes,
    payload,
    qsf,
    remarks,
)


def left_out(draft: Draft) -> int:
    return [note.outcome for note in draft.report.notes].count(ImportOutcome.LEFT_OUT)


FRUIT = displays("Apple", "Pear", "Plum")


def test_one_of_several_options_keeps_its_recode_values_and_whether_it_is_required():
    (item,) = items(
        qsf(
            payload(
                *("Q1", "MC", "SAVR", "TX"),
                Choices=FRUIT,
                ChoiceOrder=["2", "1", "3"],
                RecodeValues={"1": "10", "2": "20", "3": "30"},
                Validation=forced(),
                Randomization={"Type": "All"},
            )
        )
    )
    assert item["kind"] == "single"
    assert [(one["value"], one["label"]["en"]) for one in item["options"]] == [
        ("20", "Pear"),
        ("10", "Apple"),
        ("30", "Plum"),
    ]
    assert (item["key"], item["required"], item["order"]) == ("q1", True, "shuffled")


def test_several_options_keep_what_excludes_the_others_and_how_many():
    settings = {"ForceResponse": "ON", "Type": "ChoiceRange", "MinChoices": "1", "MaxChoices": "2"}
    (item,) = items(
        qsf(
            payload(
                *("Q1", "MC", "MAVR", "TX"),
                Choices={**FRUIT, "4": {"Display": "None", "ExclusiveAnswer": True}},
                Validation={"Settings": settings},
            )
        )
    )
    assert item["kind"] == "multiple"
    assert (item["at_least"], item["at_most"]) == (1, 2)
    assert [one.get("alone", False) for one in item["options"]] == [False, False, False, True]


def test_an_option_with_a_text_gets_a_question_that_is_asked_when_it_is_chosen():
    document = qsf(
        payload(
            *("Q1", "MC", "SAVR", "TX"),
            Choices={**FRUIT, "4": {"Display": "Other:", "TextEntry": "true"}},
        )
    )
    single, text = items(document)
    assert (text["kind"], text["show_if"]) == ("text", {"item": single["key"], "is": ["4"]})
    assert "Other:" in remarks(document, "Q1")


def test_a_net_promoter_score_is_a_scale_from_0_to_10_with_its_words_at_the_ends():
    document = qsf(
        payload(
            *("Q1", "MC", "NPS"),
            Choices=[{"Display": str(n)} for n in range(11)],
            ChoiceOrder=[str(n) for n in range(11)],
            ColumnLabels=[{"Display": "Never"}, {"Display": "Surely"}],
        )
    )
    definition = read(document).definition("test", 1)
    points = definition.scales["scale_1"]
    assert [point.value for point in points] == list(range(11))
    assert (points[0].label, points[10].label) == ({"en": "Never"}, {"en": "Surely"})


def matrix(sub: str = "SingleAnswer", answers=("No", "Maybe", "Yes"), **more) -> bytes:
    return qsf(
        payload(
            *("Q1", "Matrix", "Likert", sub),
            Choices=displays("It is easy", "It is fun"),
            Answers=displays(*answers),
            AnswerOrder=[str(n + 1) for n in range(len(answers))],
            **more,
        )
    )


def test_a_matrix_is_a_grid_whose_rows_have_their_export_tags():
    document = matrix(ChoiceDataExportTags={"1": "easy", "2": "Fun 2"})
    (item,) = items(document)
    assert item["kind"] == "grid"
    assert [(row["key"], row["text"]["en"]) for row in item["rows"]] == [
        ("easy", "It is easy"),
        ("fun_2", "It is fun"),
    ]
    assert outcomes(document)["Q1"] is ImportOutcome.IMPORTED


def test_recode_values_that_fall_keep_the_order_shown_and_are_reported_as_reversed():
    document = matrix(RecodeValues={"1": "3", "2": "2", "3": "1"})
    definition = read(document).definition("test", 1)
    assert [point.value for point in definition.scales["scale_1"]] == [1, 2, 3]
    assert [point.label["en"] for point in definition.scales["scale_1"]] == ["No", "Maybe", "Yes"]
    assert "3 → 1, 2 → 2, 1 → 3" in remarks(document, "Q1")
    assert "reverse" in remarks(document, "Q1")


def test_recode_values_that_rise_are_kept():
    definition = read(matrix(RecodeValues={"1": "-2", "2": 0, "3": "2"})).definition("test", 1)
    assert [point.value for point in definition.scales["scale_1"]] == [-2, 0, 2]


def test_a_column_not_applicable_is_a_reason_for_no_answer():
    document = matrix(answers=("No", "Maybe", "Yes", "N/A"))
    (item,) = items(document)
    assert item["not_applicable"] is True
    assert len(read(document).definition("test", 1).scales["scale_1"]) == 3
    assert "N/A" in remarks(document, "Q1")


def test_a_matrix_with_several_answers_is_a_question_for_each_row():
    document = matrix("MultipleAnswer")
    assert [(item["kind"], item["text"]["en"]) for item in items(document)] == [
        ("multiple", "Text of Q1 – It is easy"),
        ("multiple", "Text of Q1 – It is fun"),
    ]
    assert "Each row" in remarks(document, "Q1")


def test_a_matrix_of_more_than_eleven_points_is_a_list_of_options_for_each_row():
    document = matrix(answers=tuple(str(n) for n in range(12)))
    assert [item["kind"] for item in items(document)] == ["single", "single"]


def test_bipolar_rows_have_their_own_words_at_the_ends():
    document = qsf(
        payload(
            *("Q1", "Matrix", "Bipolar"),
            Choices=displays("slow:fast", "bad:good"),
            Answers=displays("1", "2", "3", "4", "5"),
        )
    )
    definition = read(document).definition("test", 1)
    assert [points[0].label["en"] for points in definition.scales.values()] == ["slow", "bad"]
    assert [points[4].label["en"] for points in definition.scales.values()] == ["fast", "good"]


def test_columns_beside_each_other_are_questions_of_their_own():
    column = {"QuestionType": "Matrix", "Selector": "Likert", "SubSelector": "SingleAnswer"}
    document = qsf(
        payload(
            *("Q1", "SBS", "SBSMatrix"),
            Choices=displays("A", "B"),
            AdditionalQuestions={
                "1": {**column, "QuestionText": "Trust", "Answers": displays("low", "high")},
                "2": {**column, "QuestionText": "Use", "Answers": displays("rare", "often")},
            },
        )
    )
    assert [item["text"]["en"] for item in items(document)] == [
        "Text of Q1 – Trust",
        "Text of Q1 – Use",
    ]


def test_validation_tells_texts_numbers_and_days_apart():
    number = {
        "ForceResponse": "OFF",
        "Type": "ContentType",
        "ContentType": "ValidNumber",
        "ValidNumber": {"Min": "18", "Max": "99", "NumDecimals": "0"},
    }
    mail = {"Type": "ContentType", "ContentType": "ValidEmail"}
    day = {"Type": "ContentType", "ContentType": "ValidDate"}
    document = qsf(
        payload("Q1", "TE", "SL"),
        payload("Q2", "TE", "ML"),
        payload("Q3", "TE", "SL", Validation={"Settings": number}),
        payload("Q4", "TE", "SL", Validation={"Settings": day}),
        payload("Q5", "TE", "SL", Validation={"Settings": mail}),
        payload("Q6", "TE", "PW"),
    )
    found = {item["key"]: item for item in items(document)}
    assert [found[key]["kind"] for key in ("q1", "q2", "q3", "q4", "q5")] == [
        *("text", "text", "number", "date", "text"),
    ]
    assert found["q2"]["lines"] == 4
    assert (found["q3"]["minimum"], found["q3"]["maximum"], found["q3"]["whole"]) == (18, 99, True)
    assert "e-mail" in remarks(document, "Q5")
    assert outcomes(document)["Q6"] is ImportOutcome.LEFT_OUT


def test_sliders_have_the_ends_of_their_question_and_its_first_and_last_label():
    document = qsf(
        payload(
            *("Q1", "Slider", "HSLIDER"),
            Choices=displays("Speed", "Ease"),
            Labels=displays("low", "middle", "high"),
            Configuration={"CSSliderMin": 1, "CSSliderMax": 10, "NotApplicable": True},
        )
    )
    first, _second = items(document)
    assert (first["minimum"], first["maximum"], first["low"], first["high"]) == (
        *(1, 10),
        {"en": "low"},
        {"en": "high"},
    )
    assert first["not_applicable"] is True
    assert "between the two ends" in remarks(document, "Q1")


def test_a_rank_order_is_a_ranking():
    (item,) = items(qsf(payload("Q1", "RO", "DND", "TX", Choices=FRUIT)))
    assert (item["kind"], len(item["options"])) == ("ranking", 3)


@pytest.mark.parametrize("kind", ["CS", "PGR", "Timing", "Meta", "HeatMap", "FileUpload", "X"])
def test_a_type_without_a_counterpart_is_listed_with_its_name(kind):
    document = qsf(payload("Q1", kind, "Y"), payload("Q2", "TE", "SL"))
    assert outcomes(document) == {"Q1": ImportOutcome.LEFT_OUT, "Q2": ImportOutcome.IMPORTED}
    assert f"{kind}/Y" in remarks(document, "Q1")


def test_a_question_that_the_rules_here_refuse_is_listed_with_the_reason():
    many = displays(*(f"Item {n}" for n in range(25)))
    document = qsf(payload("Q1", "RO", "DND", Choices=many), payload("Q2", "TE", "SL"))
    assert "this one has 25" in remarks(document, "Q1")
    assert [item["key"] for item in items(document)] == ["q2"]


# --- pages, flow, texts ---------------------------------------------------------------------------


def block(name: str, *elements: str, **more) -> dict:
    return {
        "Type": "Standard",
        "ID": name,
        "BlockElements": [
            {"Type": "Page Break"} if one == "|" else {"Type": "Question", "QuestionID": one}
            for one in elements
        ],
        **more,
    }


def texts(*names: str) -> list[dict]:
    return [payload(name, "TE", "SL") for name in names]


def test_blocks_and_page_breaks_are_pages_in_the_order_of_the_flow():
    document = qsf(
        *texts("Q1", "Q2", "Q3"),
        blocks=[block("BL_1", "Q1", "|", "Q2"), block("BL_2", "Q3")],
        flow=[{"Type": "Standard", "ID": "BL_2"}, {"Type": "Block", "ID": "BL_1"}],
    )
    pages = read(document).definition("test", 1).pages
    assert [[item.key for item in page.items] for page in pages] == [["q3"], ["q1"], ["q2"]]


def test_questions_in_the_trash_are_listed():
    document = qsf(
        *texts("Q1", "Q2"),
        blocks=[block("BL_1", "Q1"), {**block("BL_2", "Q2"), "Type": "Trash"}],
    )
    assert outcomes(document) == {"Q1": ImportOutcome.IMPORTED, "Q2": ImportOutcome.LEFT_OUT}


def test_branches_and_random_blocks_are_listed_and_their_questions_are_asked():
    document = qsf(
        *texts("Q1", "Q2"),
        blocks=[block("BL_1", "Q1"), block("BL_2", "Q2")],
        flow=[
            {"Type": "Branch", "Description": "If", "Flow": [{"Type": "Block", "ID": "BL_1"}]},
            {"Type": "BlockRandomizer", "Flow": [{"Type": "Block", "ID": "BL_2"}]},
            {"Type": "EmbeddedData", "EmbeddedData": []},
        ],
    )
    assert [item["key"] for item in items(document)] == ["q1", "q2"]
    assert left_out(read(document)) == 3


def test_a_text_without_a_question_introduces_a_page():
    document = qsf(
        payload("Q1", "DB", "TB", text="<p>Welcome&nbsp;here</p>"),
        *texts("Q2"),
        payload("Q3", "DB", "TB", text="Now the second part"),
        *texts("Q4"),
        payload("Q5", "DB", "TB", text="Thank you"),
    )
    pages = read(document).definition("test", 1).pages
    assert [page.intro["en"] for page in pages] == ["Welcome here", "Now the second part"]
    found = outcomes(document)
    assert (found["Q1"], found["Q3"], found["Q5"]) == (
        *(ImportOutcome.IMPORTED, ImportOutcome.CHANGED, ImportOutcome.LEFT_OUT),
    )


def test_markup_becomes_plain_text_and_losses_are_reported():
    document = qsf(
        payload(
            *("Q1", "TE", "SL"),
            text='<b>Look</b> at this:<br><img src="x.png" alt="a robot"><script>bad()</script>',
        )
    )
    assert items(document)[0]["text"]["en"] == "Look at this:\na robot"
    assert "img, script" in remarks(document, "Q1")


def test_a_text_that_inserts_an_earlier_answer_is_reported():
    document = qsf(payload("Q1", "TE", "SL", text="Why ${q://QID1/ChoiceGroup/SelectedChoices}?"))
    assert "inserts" in remarks(document, "Q1")


def test_translations_are_kept_and_one_that_is_missing_is_reported():
    translated = {
        "DE": {"QuestionText": "Obst?", "Choices": displays("Apfel", "Birne", "Pflaume")},
        "PT-BR": {"QuestionText": "Fruta?", "Choices": displays("Maçã", "Pera", "Ameixa")},
    }
    document = qsf(
        payload("Q1", "MC", "SAVR", Choices=FRUIT, Language=translated, text="Fruit?"),
        *texts("Q2"),
    )
    definition = read(document).definition("test", 1)
    assert definition.languages == ("en", "de", "pt-br")
    assert definition.pages[0].items[0].text == {"en": "Fruit?", "de": "Obst?", "pt-br": "Fruta?"}
    assert definition.pages[0].items[0].options[1].label["de"] == "Birne"
    assert definition.pages[0].items[1].text["de"] == "Text of Q2"
    assert "de, pt-br" in remarks(document, "Q2")


def test_a_loss_in_several_texts_of_a_question_is_reported_once():
    translated = {"DE": {"QuestionText": "Warum?"}}
    document = qsf(
        payload("Q1", "MC", "SAVR", Choices=FRUIT), payload("Q2", "TE", "SL", Language=translated)
    )
    assert remarks(document, "Q1").count("A text is missing in de") == 1


def test_a_language_that_is_offered_without_a_translation_is_listed():
    options = {"Element": "SO", "Payload": {"AvailableLanguages": {"EN": [], "FR": []}}}
    assert outcomes(qsf(*texts("Q1"), extra=[options]))["fr"] is ImportOutcome.LEFT_OUT


# --- conditions -----------------------------------------------------------------------------------


def logic(*parts: tuple[str, str], joined: str = "Or", operator: str = "Selected") -> dict:
    found = {
        str(n): {
            "LogicType": "Question",
            "LeftOperand": f"q://{question}/SelectableChoice/{choice}",
            "Operator": operator,
            **({"Conjuction": joined} if n else {}),
        }
        for n, (question, choice) in enumerate(parts)
    }
    return {"0": {**found, "Type": "If"}, "Type": "BooleanExpression"}


def conditional(condition: dict) -> bytes:
    return qsf(
        payload("Q1", "MC", "SAVR", Choices=FRUIT, RecodeValues={"1": "7"}),
        payload("Q2", "TE", "SL", DisplayLogic=condition),
    )


def test_display_logic_that_asks_for_chosen_options_is_a_condition():
    document = conditional(logic(("Q1", "1"), ("Q1", "3")))
    assert items(document)[1]["show_if"] == {"item": "q1", "is": ["7", "3"]}
    assert outcomes(document)["Q2"] is ImportOutcome.IMPORTED


@pytest.mark.parametrize(
    "condition",
    [
        logic(("Q1", "1"), ("Q1", "3"), joined="And"),
        logic(("Q1", "1"), operator="NotSelected"),
        logic(("Q9", "1")),
        {"0": {"0": {"LogicType": "DeviceType", "LeftOperand": "mobile", "Operator": "Is"}}},
    ],
)
def test_other_display_logic_is_reported_and_the_question_is_shown_to_everybody(condition):
    document = conditional(condition)
    assert "show_if" not in items(document)[1]
    assert "shown to everybody" in remarks(document, "Q2")


def test_a_condition_on_a_shuffled_page_is_reported():
    document = qsf(
        payload("Q1", "MC", "SAVR", Choices=FRUIT),
        payload("Q2", "TE", "SL", DisplayLogic=logic(("Q1", "1"))),
        blocks=[block("BL_1", "Q1", "Q2", Options={"RandomizeQuestions": "RandomizeAll"})],
    )
    assert read(document).definition("test", 1).pages[0].order == "shuffled"
    assert "shown to everybody" in remarks(document, "Q2")


# --- names and bounds -----------------------------------------------------------------------------


def test_names_fit_and_are_unique():
    long = "A very long name of a question that nobody should have written"
    document = qsf(
        payload("Q1", "TE", "SL", tag="1. Age?"),
        payload("Q2", "TE", "SL", tag="1 age"),
        payload("Q3", "TE", "SL", tag=long),
    )
    keys = [item["key"] for item in items(document)]
    assert keys[:2] == ["q_1_age", "q_1_age_2"]
    assert len(keys[2]) <= 40


def test_a_question_that_is_left_out_does_not_take_a_name():
    document = qsf(
        payload("Q1", "MC", "SAVR", tag="age", Choices={}), payload("Q2", "TE", "SL", tag="age")
    )
    assert [item["key"] for item in items(document)] == ["age"]


def test_questions_beyond_the_limit_are_listed():
    draft = read(qsf(*texts(*(f"Q{n}" for n in range(305)))))
    assert len(draft.definition("test", 1).questions()) == 300
    assert left_out(draft) == 5


def test_a_file_of_which_nothing_can_be_imported_is_refused_with_a_reason():
    with pytest.raises(BadDefinitionError, match="None of the file's questions"):
        read(qsf(payload("Q1", "Timing", "PageTimer"))).definition("test", 1)


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (b'{"SurveyElements": [', "not valid JSON"),
        (b'{"SurveyElements": 3}', "no list"),
        (b'{"SurveyElements": [1]}', "no list"),
        (b'{"SurveyElements": ' + b"[" * 100_000, "not valid JSON"),
    ],
)
def test_a_malformed_file_is_refused_with_a_clear_message(document, message):
    with pytest.raises(BadDefinitionError, match=message):
        read(document)
