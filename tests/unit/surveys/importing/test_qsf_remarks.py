"""Qualtrics files: remarks on parts that are changed or left out, and odd files."""

import pytest

from surveys.documents import BadDefinitionError
from surveys.importing.reading import read
from surveys.importing.report import ImportOutcome
from tests.support.studies.survey_files import displays, items, outcomes, payload, qsf, remarks
from tests.unit.surveys.importing.test_qsf import FRUIT, block, matrix, texts


def settings(**more) -> dict:
    return {"Validation": {"Settings": more}}


# --- the flow -------------------------------------------------------------------------------------


def test_a_flow_that_names_a_block_which_is_not_in_the_file_is_read_without_it():
    flow = [{"Type": "Block", "ID": "BL_9"}, {"Type": "Block", "ID": "BL_1"}]
    assert [item["key"] for item in items(qsf(*texts("Q1"), flow=flow))] == ["q1"]


def test_a_block_in_the_flow_that_is_in_the_trash_is_not_asked():
    document = qsf(
        *texts("Q1", "Q2"),
        blocks=[block("BL_1", "Q1"), {**block("BL_2", "Q2"), "Type": "Trash"}],
        flow=[{"Type": "Block", "ID": "BL_2"}, {"Type": "Block", "ID": "BL_1"}],
    )
    assert [item["key"] for item in items(document)] == ["q1"]


def test_a_flow_that_is_nested_without_end_is_read_as_far_as_it_is_sensible():
    inner = {"Type": "Block", "ID": "BL_2"}
    for _depth in range(50):
        inner = {"Type": "Group", "Flow": [inner]}
    document = qsf(
        *texts("Q1", "Q2"),
        blocks=[block("BL_1", "Q1"), block("BL_2", "Q2")],
        flow=[{"Type": "Block", "ID": "BL_1"}, inner],
    )
    assert outcomes(document) == {"Q1": ImportOutcome.IMPORTED, "Q2": ImportOutcome.LEFT_OUT}


def test_a_looping_block_is_asked_once_and_reported():
    looping = {**block("BL_1", "Q1"), "Description": "Robots", "Options": {"Looping": "Static"}}
    document = qsf(*texts("Q1"), blocks=[looping])
    assert [item["key"] for item in items(document)] == ["q1"]
    assert "Loops" in remarks(document, "Block: Robots")


def test_a_block_that_names_a_question_which_is_not_in_the_file_is_read_without_it():
    document = qsf(*texts("Q1"), blocks=[block("BL_1", "Q9", "Q1")])
    assert [item["key"] for item in items(document)] == ["q1"]


def test_footers_end_messages_and_scoring_of_the_survey_are_reported():
    extra = [
        {"Element": "SO", "Payload": {"Footer": "The university", "EOSMessage": "MS_1"}},
        {"Element": "SCO", "Payload": {"ScoringCategories": [{"ID": "SC_0"}]}},
    ]
    found = outcomes(qsf(*texts("Q1"), extra=extra))
    assert [name for name, one in found.items() if one is ImportOutcome.LEFT_OUT] == [
        *("Footer", "EOSMessage", "Scoring"),
    ]


# --- remarks on a question ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"QuestionJS": "alert(1)"}, "JavaScript"),
        ({"GradingData": [{"ChoiceID": "1"}]}, "scores"),
        ({"DefaultChoices": {"1": {"Selected": True}}}, "default answer"),
        (settings(CustomValidation={"Logic": {}}), "validation rules"),
        (settings(Type="CustomValidation"), "validation rules"),
        (settings(ForceResponse="RequestResponse"), "optional"),
        (settings(ForceResponse="ON", ForceResponseType="RequestResponse"), "optional"),
        ({"Randomization": {"Type": "Advanced"}}, "random order with rules"),
        ({"DynamicChoices": {"Locator": "q://Q0"}}, "carried forward"),
        ({"Choices": {"1": {"Display": "A", "DisplayLogic": {"0": {}}}}}, "single options"),
        ({"RecodeValues": {"1": "5", "2": "5"}}, "share a recode value"),
        ({"QuestionText": ""}, "its name is shown"),
    ],
)
def test_differences_from_the_file_are_reported(more, message):
    document = qsf(payload("Q1", "MC", "SAVR", Choices=FRUIT) | more)
    (item,) = items(document)
    assert not item.get("required")
    assert message in remarks(document, "Q1")


def test_options_that_share_a_recode_value_keep_their_ids():
    recoded = {"1": "5", "2": "5", "3": "6"}
    (item,) = items(qsf(payload("Q1", "MC", "SAVR", Choices=FRUIT, RecodeValues=recoded)))
    assert [one["value"] for one in item["options"]] == ["1", "2", "3"]


def test_skip_logic_is_reported():
    asked = {"Type": "Question", "QuestionID": "Q1", "SkipLogic": [{"SkipToDestination": "Q3"}]}
    document = qsf(*texts("Q1"), blocks=[{"ID": "BL_1", "BlockElements": [asked]}])
    assert "nothing is skipped" in remarks(document, "Q1")


def test_a_text_entry_of_a_ranked_option_is_reported():
    choices = {**FRUIT, "4": {"Display": "Other", "TextEntry": "on"}}
    document = qsf(payload("Q1", "RO", "DND", Choices=choices))
    assert len(items(document)[0]["options"]) == 4
    assert "text entry" in remarks(document, "Q1")


def test_a_bound_that_is_no_number_is_none():
    number = {"Min": "some", "Max": {"1": 2}, "NumDecimals": "2"}
    rules = settings(Type="ContentType", ContentType="ValidNumber", ValidNumber=number)
    (item,) = items(qsf(payload("Q1", "TE", "SL") | rules))
    assert (item["kind"], item.keys() & {"minimum", "maximum", "whole"}) == ("number", set())


@pytest.mark.parametrize("number", ["1" * 5000, "9" * 10])
def test_a_net_promoter_score_leaves_out_a_point_of_thousands_of_digits(number):
    choices = {number: {"Display": "x"}} | {str(n): {"Display": str(n)} for n in range(11)}
    definition = read(qsf(payload("Q1", "MC", "NPS", Choices=choices))).definition("test", 1)
    assert [point.value for point in definition.scales["scale_1"]] == list(range(11))


# --- sliders and matrices -------------------------------------------------------------------------


def test_one_slider_with_stars_and_grid_lines_is_one_question_with_steps():
    document = qsf(
        payload(
            *("Q1", "Slider", "STAR"),
            Choices=displays("Speed"),
            Configuration={
                "CSSliderMin": 0,
                "CSSliderMax": 10,
                "GridLines": 5,
                "NumDecimals": "1",
                "SnapToGrid": True,
            },
        )
    )
    (item,) = items(document)
    assert (item["step"], item["low"], item["high"]) == (2, {"en": "0"}, {"en": "10"})
    found = remarks(document, "Q1")
    assert "stars" in found
    assert "whole numbers" in found
    assert "Each slider" not in found


def test_grid_lines_that_do_not_divide_a_slider_make_no_steps():
    lines = {"CSSliderMin": 0, "CSSliderMax": 10, "GridLines": 3, "SnapToGrid": "true"}
    document = qsf(payload("Q1", "Slider", "HSLIDER", Configuration=lines))
    assert [(item["key"], item.get("step", 1)) for item in items(document)] == [("q1", 1)]


def test_a_matrix_of_texts_is_a_question_for_each_cell():
    choices = {"1": {"Display": "Morning", "TextEntry": "on"}, "2": {"Display": "Evening"}}
    document = qsf(
        payload(*("Q1", "Matrix", "TE", "Essay"), Choices=choices, Answers=displays("Good", "Bad"))
    )
    found = items(document)
    assert [one["key"] for one in found] == ["q1_1_1", "q1_1_2", "q1_2_1", "q1_2_2"]
    assert found[3]["text"]["en"] == "Text of Q1 – Evening – Bad"
    assert {one["lines"] for one in found} == {4}
    assert "text entry in a row" in remarks(document, "Q1")


def test_a_matrix_of_texts_without_columns_is_a_question_for_each_row():
    document = qsf(payload("Q1", "Matrix", "TE", "Short", Choices=displays("A", "", "C")))
    assert [one["key"] for one in items(document)] == ["q1_1", "q1_3"]
    assert "row without a text" in remarks(document, "Q1")


def test_a_matrix_with_several_answers_that_share_a_recode_value_keeps_their_ids():
    document = matrix("MultipleAnswer", RecodeValues={"1": "5", "2": "5"})
    assert [one["value"] for one in items(document)[0]["options"]] == ["1", "2", "3"]


@pytest.mark.parametrize(
    "question",
    [
        payload("Q1", "Matrix", "MaxDiff", Choices=FRUIT),
        payload("Q1", "TE", "Autocomplete"),
        payload("Q1", "MC", "NoSuch", Choices=FRUIT),
        payload(
            *("Q1", "SBS", "SBSMatrix"),
            Choices=FRUIT,
            AdditionalQuestions={"1": {"QuestionType": "SBS", "Selector": "SBSMatrix"}},
        ),
    ],
)
def test_a_selector_without_a_counterpart_is_listed_with_its_name(question):
    document = qsf(question, *texts("Q2"))
    assert outcomes(document) == {"Q1": ImportOutcome.LEFT_OUT, "Q2": ImportOutcome.IMPORTED}
    assert f"{question['QuestionType']}/{question['Selector']}" in remarks(document, "Q1")


# --- the whole ------------------------------------------------------------------------------------


def test_a_file_with_more_text_than_a_questionnaire_holds_is_refused():
    long = "x" * 3900
    document = qsf(*(payload(f"Q{n}", "TE", "SL", text=long) for n in range(140)))
    with pytest.raises(BadDefinitionError, match="larger than 512 kB"):
        read(document).definition("test", 1)


def test_a_text_that_is_too_long_is_shortened_and_reported():
    document = qsf(payload("Q1", "TE", "SL", text="x" * 5000))
    assert len(items(document)[0]["text"]["en"]) == 4000
    assert "shortened" in remarks(document, "Q1")
