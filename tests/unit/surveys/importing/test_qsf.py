"""Qualtrics files: what each kind of question becomes, remarks, and malformed files."""

import pytest

from surveys.documents import BadDefinitionError
from surveys.importing.draft import Draft
from surveys.importing.reading import read
from surveys.importing.report import ImportOutcome
from tests.support.studies.survey_files import (
    definition_of,
    displays,
    items,
    outcomes,
    payload,
    points_of,
    qsf,
    remarks,
)

FRUIT = displays("Apple", "Pear", "Plum")
FREE_TEXT = {"4": {"Display": "Other:", "TextEntry": "true"}}
LEFT_OUT, IMPORTED = ImportOutcome.LEFT_OUT, ImportOutcome.IMPORTED


def left_out(draft: Draft) -> int:
    return [note.outcome for note in draft.report.notes].count(LEFT_OUT)


def question(kind: str, selector: str, sub: str | None = None, **more) -> dict:
    return payload("Q1", kind, selector, sub, **more)


def choice(selector: str = "SAVR", **more) -> dict:
    return question("MC", selector, "TX", **{"Choices": FRUIT, **more})


def entry(selector: str = "SL", **more) -> dict:
    return question("TE", selector, **more)


def matrix(sub: str = "SingleAnswer", answers=("No", "Maybe", "Yes"), **more) -> dict:
    return question(
        *("Matrix", "Likert", sub),
        Choices=displays("It is easy", "It is fun"),
        Answers=displays(*answers),
        AnswerOrder=[str(n + 1) for n in range(len(answers))],
        **more,
    )


def sliders(selector: str = "HSLIDER", choices=FRUIT, **configuration) -> dict:
    ends = {"CSSliderMin": 0, "CSSliderMax": 10}
    return question("Slider", selector, Choices=choices, Configuration=ends | configuration)


def settings(**more) -> dict:
    return {"Validation": {"Settings": more}}


def content(kind: str, **more) -> dict:
    return settings(Type="ContentType", ContentType=kind, **more)


AGE = {"Min": "18", "Max": "99", "NumDecimals": "0"}


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        pytest.param(
            choice(**settings(ForceResponse="ON"), Randomization={"Type": "All"}),
            {"kind": "single", "key": "q1", "required": True, "order": "shuffled"},
            id="one option",
        ),
        pytest.param(
            choice("MAVR", **settings(Type="ChoiceRange", MinChoices="1", MaxChoices="2")),
            {"kind": "multiple", "at_least": 1, "at_most": 2},
            id="several options",
        ),
        pytest.param(entry("SL"), {"kind": "text"}, id="a line of text"),
        pytest.param(entry("ML"), {"kind": "text", "lines": 4}, id="lines of text"),
        pytest.param(
            entry(**content("ValidNumber", ValidNumber=AGE)),
            {"kind": "number", "minimum": 18, "maximum": 99, "whole": True},
            id="a whole number",
        ),
        pytest.param(entry(**content("ValidDate")), {"kind": "date"}, id="a day"),
        pytest.param(entry(**content("ValidEmail")), {"kind": "text"}, id="an e-mail address"),
        pytest.param(question("RO", "DND", "TX", Choices=FRUIT), {"kind": "ranking"}, id="ranking"),
        pytest.param(matrix(), {"kind": "grid"}, id="matrix"),
        pytest.param(
            entry(text='<b>Look</b> at:<br><img src="x.png" alt="a robot"><script>x()</script>'),
            {"text": {"en": "Look at:\na robot"}},
            id="markup",
        ),
    ],
)
def test_question_becomes_one_question_of_its_kind(asked, expected):
    (item,) = items(qsf(asked))
    assert item | expected == item


def test_options_have_their_recode_values_in_the_order_of_the_file():
    recoded = {"1": "10", "2": "20", "3": "30"}
    (item,) = items(qsf(choice(ChoiceOrder=["2", "1", "3"], RecodeValues=recoded)))
    assert [(one["value"], one["label"]["en"]) for one in item["options"]] == [
        ("20", "Pear"),
        ("10", "Apple"),
        ("30", "Plum"),
    ]


def test_exclusive_option_excludes_the_others():
    choices = {**FRUIT, "4": {"Display": "None", "ExclusiveAnswer": True}}
    (item,) = items(qsf(choice("MAVR", Choices=choices)))
    assert [one.get("alone", False) for one in item["options"]] == [False, False, False, True]


def test_option_with_a_text_entry_gets_a_question_asked_when_it_is_chosen():
    document = qsf(choice(Choices=FRUIT | FREE_TEXT))
    single, text = items(document)
    assert (text["kind"], text["show_if"]) == ("text", {"item": single["key"], "is": ["4"]})
    assert "Other:" in remarks(document, "Q1")


def test_net_promoter_score_is_a_scale_from_0_to_10_with_labelled_ends():
    document = qsf(
        question(
            *("MC", "NPS"),
            Choices=[{"Display": str(n)} for n in range(11)],
            ChoiceOrder=[str(n) for n in range(11)],
            ColumnLabels=[{"Display": "Never"}, {"Display": "Surely"}],
        )
    )
    points = points_of(document)
    assert [point.value for point in points] == list(range(11))
    assert (points[0].label, points[10].label) == ({"en": "Never"}, {"en": "Surely"})


@pytest.mark.parametrize("number", ["1" * 5000, "9" * 10])
def test_net_promoter_score_leaves_out_a_point_of_too_many_digits(number):
    choices = {number: {"Display": "x"}} | {str(n): {"Display": str(n)} for n in range(11)}
    points = points_of(qsf(question("MC", "NPS", Choices=choices)))
    assert [point.value for point in points] == list(range(11))


def test_rows_of_a_grid_have_the_export_tags_of_the_matrix():
    document = qsf(matrix(ChoiceDataExportTags={"1": "easy", "2": "Fun 2"}))
    (item,) = items(document)
    assert [(row["key"], row["text"]["en"]) for row in item["rows"]] == [
        ("easy", "It is easy"),
        ("fun_2", "It is fun"),
    ]
    assert outcomes(document)["Q1"] is IMPORTED


def test_falling_recode_values_keep_the_order_shown_and_are_reported_as_reversed():
    document = qsf(matrix(RecodeValues={"1": "3", "2": "2", "3": "1"}))
    points = points_of(document)
    assert [point.value for point in points] == [1, 2, 3]
    assert [point.label["en"] for point in points] == ["No", "Maybe", "Yes"]
    assert "3 → 1, 2 → 2, 1 → 3" in remarks(document, "Q1")
    assert "reverse" in remarks(document, "Q1")


def test_rising_recode_values_are_kept():
    points = points_of(qsf(matrix(RecodeValues={"1": "-2", "2": 0, "3": "2"})))
    assert [point.value for point in points] == [-2, 0, 2]


def test_column_not_applicable_is_a_reason_for_no_answer():
    document = qsf(matrix(answers=("No", "Maybe", "Yes", "N/A")))
    assert items(document)[0]["not_applicable"] is True
    assert len(points_of(document)) == 3
    assert "N/A" in remarks(document, "Q1")


def test_matrix_with_several_answers_is_a_question_for_each_row():
    document = qsf(matrix("MultipleAnswer"))
    assert [(item["kind"], item["text"]["en"]) for item in items(document)] == [
        ("multiple", "Text of Q1 – It is easy"),
        ("multiple", "Text of Q1 – It is fun"),
    ]
    assert "Each row" in remarks(document, "Q1")


def test_matrix_of_more_than_eleven_points_is_a_list_of_options_for_each_row():
    document = qsf(matrix(answers=tuple(str(n) for n in range(12))))
    assert [item["kind"] for item in items(document)] == ["single", "single"]


def test_bipolar_rows_have_their_own_words_at_the_ends():
    choices, answers = displays("slow:fast", "bad:good"), displays("1", "2", "3", "4", "5")
    document = qsf(question("Matrix", "Bipolar", Choices=choices, Answers=answers))
    scales = definition_of(document).scales.values()
    assert [(points[0].label["en"], points[4].label["en"]) for points in scales] == [
        *(("slow", "fast"), ("bad", "good"))
    ]


def test_matrix_of_texts_is_a_question_for_each_cell():
    choices = {"1": {"Display": "Morning", "TextEntry": "on"}, "2": {"Display": "Evening"}}
    answers = displays("Good", "Bad")
    document = qsf(question("Matrix", "TE", "Essay", Choices=choices, Answers=answers))
    found = items(document)
    assert [one["key"] for one in found] == ["q1_1_1", "q1_1_2", "q1_2_1", "q1_2_2"]
    assert found[3]["text"]["en"] == "Text of Q1 – Evening – Bad"
    assert {one["lines"] for one in found} == {4}
    assert "text entry in a row" in remarks(document, "Q1")


def test_matrix_of_texts_without_columns_is_a_question_for_each_row():
    document = qsf(question("Matrix", "TE", "Short", Choices=displays("A", "", "C")))
    assert [one["key"] for one in items(document)] == ["q1_1", "q1_3"]
    assert "row without a text" in remarks(document, "Q1")


def test_columns_side_by_side_are_questions_of_their_own():
    column = {"QuestionType": "Matrix", "Selector": "Likert", "SubSelector": "SingleAnswer"}
    columns = {
        "1": {**column, "QuestionText": "Trust", "Answers": displays("low", "high")},
        "2": {**column, "QuestionText": "Use", "Answers": displays("rare", "often")},
    }
    document = qsf(question("SBS", "SBSMatrix", Choices=FRUIT, AdditionalQuestions=columns))
    texts = [item["text"]["en"] for item in items(document)]
    assert texts == ["Text of Q1 – Trust", "Text of Q1 – Use"]


def test_sliders_have_the_ends_of_their_question_and_its_first_and_last_label():
    labels = displays("low", "middle", "high")
    document = qsf(sliders(NotApplicable=True, CSSliderMin=1) | {"Labels": labels})
    first, *_others = items(document)
    ends = {"minimum": 1, "maximum": 10, "low": {"en": "low"}, "high": {"en": "high"}}
    assert first | ends | {"not_applicable": True} == first
    assert "between the two ends" in remarks(document, "Q1")


def test_one_slider_with_stars_and_grid_lines_is_one_question_with_steps():
    lines = {"GridLines": 5, "NumDecimals": "1", "SnapToGrid": True}
    document = qsf(sliders("STAR", displays("Speed"), **lines))
    (item,) = items(document)
    assert (item["step"], item["low"], item["high"]) == (2, {"en": "0"}, {"en": "10"})
    found = remarks(document, "Q1")
    assert "stars" in found
    assert "whole numbers" in found
    assert "Each slider" not in found


def test_grid_lines_that_do_not_divide_a_slider_make_no_steps():
    document = qsf(sliders(choices={}, GridLines=3, SnapToGrid="true"))
    assert [(item["key"], item.get("step", 1)) for item in items(document)] == [("q1", 1)]


@pytest.mark.parametrize(
    "asked",
    [
        *(
            question(kind, "Y")
            for kind in ("CS", "PGR", "Timing", "Meta", "HeatMap", "FileUpload", "X")
        ),
        entry("Autocomplete"),
        question("Matrix", "MaxDiff", Choices=FRUIT),
        choice("NoSuch"),
        question(
            *("SBS", "SBSMatrix"),
            Choices=FRUIT,
            AdditionalQuestions={"1": {"QuestionType": "SBS", "Selector": "SBSMatrix"}},
        ),
    ],
    ids=lambda asked: f"{asked['QuestionType']}-{asked['Selector']}",
)
def test_question_without_a_counterpart_is_listed_with_its_name(asked):
    document = qsf(asked, *texts("Q2"))
    assert outcomes(document) == {"Q1": LEFT_OUT, "Q2": IMPORTED}
    assert f"{asked['QuestionType']}/{asked['Selector']}" in remarks(document, "Q1")


def test_question_for_a_password_is_listed():
    document = qsf(entry("PW"), *texts("Q2"))
    assert outcomes(document)["Q1"] is LEFT_OUT
    assert "passwords" in remarks(document, "Q1")


def test_question_with_too_many_options_is_listed_with_the_reason():
    many = displays(*(f"Item {n}" for n in range(25)))
    document = qsf(question("RO", "DND", Choices=many), *texts("Q2"))
    assert "this one has 25" in remarks(document, "Q1")
    assert [item["key"] for item in items(document)] == ["q2"]


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
        ({"QuestionText": "Why ${q://QID1/ChoiceGroup/SelectedChoices}?"}, "inserts"),
        ({"QuestionText": "<img src='x'><script>x()</script>Why?"}, "img, script"),
        (content("ValidEmail") | {"QuestionType": "TE", "Selector": "SL"}, "e-mail"),
    ],
)
def test_differences_from_the_file_are_reported(more, message):
    document = qsf(choice() | more)
    (item,) = items(document)
    assert not item.get("required")
    assert message in remarks(document, "Q1")


@pytest.mark.parametrize("asked", [choice(), matrix("MultipleAnswer")])
def test_options_that_share_a_recode_value_keep_their_ids(asked):
    item, *_others = items(qsf(asked | {"RecodeValues": {"1": "5", "2": "5", "3": "6"}}))
    assert [one["value"] for one in item["options"]] == ["1", "2", "3"]


def test_text_entry_of_a_ranked_option_is_reported():
    document = qsf(question("RO", "DND", Choices=FRUIT | FREE_TEXT))
    assert len(items(document)[0]["options"]) == 4
    assert "text entry" in remarks(document, "Q1")


def test_bound_that_is_not_a_number_is_left_out():
    bounds = {"Min": "some", "Max": {"1": 2}, "NumDecimals": "2"}
    (item,) = items(qsf(entry(**content("ValidNumber", ValidNumber=bounds))))
    assert (item["kind"], item.keys() & {"minimum", "maximum", "whole"}) == ("number", set())


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


def shown(*names: str) -> list[dict]:
    """Return a flow through the blocks of these names."""
    return [{"Type": "Block", "ID": name} for name in names]


def texts(*names: str) -> list[dict]:
    return [payload(name, "TE", "SL") for name in names]


def test_blocks_and_page_breaks_are_pages_in_the_order_of_the_flow():
    document = qsf(
        *texts("Q1", "Q2", "Q3"),
        blocks=[block("BL_1", "Q1", "|", "Q2"), block("BL_2", "Q3")],
        flow=[{"Type": "Standard", "ID": "BL_2"}, *shown("BL_1")],
    )
    pages = definition_of(document).pages
    assert [[item.key for item in page.items] for page in pages] == [["q3"], ["q1"], ["q2"]]


@pytest.mark.parametrize("flow", [shown("BL_1"), shown("BL_2", "BL_1")])
def test_questions_in_the_trash_are_listed_and_not_asked(flow):
    trash = {**block("BL_2", "Q2"), "Type": "Trash"}
    document = qsf(*texts("Q1", "Q2"), blocks=[block("BL_1", "Q1"), trash], flow=flow)
    assert outcomes(document) == {"Q1": IMPORTED, "Q2": LEFT_OUT}


def test_branches_and_random_blocks_are_listed_and_their_questions_are_asked():
    document = qsf(
        *texts("Q1", "Q2"),
        blocks=[block("BL_1", "Q1"), block("BL_2", "Q2")],
        flow=[
            {"Type": "Branch", "Description": "If", "Flow": shown("BL_1")},
            {"Type": "BlockRandomizer", "Flow": shown("BL_2")},
            {"Type": "EmbeddedData", "EmbeddedData": []},
        ],
    )
    assert [item["key"] for item in items(document)] == ["q1", "q2"]
    assert left_out(read(document)) == 3


@pytest.mark.parametrize(
    "more", [{"flow": shown("BL_9", "BL_1")}, {"blocks": [block("BL_1", "Q9", "Q1")]}]
)
def test_names_of_missing_blocks_and_questions_are_passed_over(more):
    assert [item["key"] for item in items(qsf(*texts("Q1"), **more))] == ["q1"]


def test_deeply_nested_part_of_a_flow_is_left_out():
    (inner,) = shown("BL_2")
    for _depth in range(50):
        inner = {"Type": "Group", "Flow": [inner]}
    blocks = [block("BL_1", "Q1"), block("BL_2", "Q2")]
    document = qsf(*texts("Q1", "Q2"), blocks=blocks, flow=[*shown("BL_1"), inner])
    assert outcomes(document) == {"Q1": IMPORTED, "Q2": LEFT_OUT}


def test_looping_block_is_asked_once_and_reported():
    looping = block("BL_1", "Q1", Description="Robots", Options={"Looping": "Static"})
    document = qsf(*texts("Q1"), blocks=[looping])
    assert [item["key"] for item in items(document)] == ["q1"]
    assert "Loops" in remarks(document, "Block: Robots")


def test_skip_logic_is_reported():
    asked = {"Type": "Question", "QuestionID": "Q1", "SkipLogic": [{"SkipToDestination": "Q3"}]}
    document = qsf(*texts("Q1"), blocks=[{"ID": "BL_1", "BlockElements": [asked]}])
    assert "nothing is skipped" in remarks(document, "Q1")


def test_footers_end_messages_and_scoring_of_the_survey_are_reported():
    extra = [
        {"Element": "SO", "Payload": {"Footer": "The university", "EOSMessage": "MS_1"}},
        {"Element": "SCO", "Payload": {"ScoringCategories": [{"ID": "SC_0"}]}},
    ]
    found = outcomes(qsf(*texts("Q1"), extra=extra))
    listed = [name for name, one in found.items() if one is LEFT_OUT]
    assert listed == ["Footer", "EOSMessage", "Scoring"]


def test_text_without_a_question_introduces_a_page():
    document = qsf(
        question("DB", "TB", text="<p>Welcome&nbsp;here</p>"),
        *texts("Q2"),
        payload("Q3", "DB", "TB", text="Now the second part"),
        *texts("Q4"),
        payload("Q5", "DB", "TB", text="Thank you"),
    )
    pages = definition_of(document).pages
    assert [page.intro["en"] for page in pages] == ["Welcome here", "Now the second part"]
    found = outcomes(document)
    assert [found[name] for name in ("Q1", "Q3", "Q5")] == [
        *(IMPORTED, ImportOutcome.CHANGED, LEFT_OUT)
    ]


def test_translations_are_kept_and_missing_ones_are_reported_once_a_question():
    translated = {
        "DE": {"QuestionText": "Obst?", "Choices": displays("Apfel", "Birne", "Pflaume")},
        "PT-BR": {"QuestionText": "Fruta?", "Choices": displays("Maçã", "Pera", "Ameixa")},
    }
    untranslated = payload("Q2", "MC", "SAVR", Choices=FRUIT)
    document = qsf(choice(Language=translated, text="Fruit?"), untranslated)
    definition = definition_of(document)
    assert definition.languages == ("en", "de", "pt-br")
    first, second = definition.pages[0].items
    assert first.text == {"en": "Fruit?", "de": "Obst?", "pt-br": "Fruta?"}
    assert first.options[1].label["de"] == "Birne"
    assert second.text["de"] == "Text of Q2"
    assert remarks(document, "Q2").count("A text is missing in de, pt-br") == 1


def test_language_that_is_offered_without_a_translation_is_listed():
    options = {"Element": "SO", "Payload": {"AvailableLanguages": {"EN": [], "FR": []}}}
    assert outcomes(qsf(*texts("Q1"), extra=[options]))["fr"] is LEFT_OUT


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


def conditional(condition: dict, **more) -> bytes:
    text = payload("Q2", "TE", "SL", DisplayLogic=condition)
    return qsf(choice(RecodeValues={"1": "7"}), text, **more)


def test_display_logic_that_asks_for_chosen_options_is_a_condition():
    document = conditional(logic(("Q1", "1"), ("Q1", "3")))
    assert items(document)[1]["show_if"] == {"item": "q1", "is": ["7", "3"]}
    assert outcomes(document)["Q2"] is IMPORTED


@pytest.mark.parametrize(
    "condition",
    [
        logic(("Q1", "1"), ("Q1", "3"), joined="And"),
        logic(("Q1", "1"), operator="NotSelected"),
        logic(("Q9", "1")),
        {"0": {"0": {"LogicType": "DeviceType", "LeftOperand": "mobile", "Operator": "Is"}}},
    ],
)
def test_other_display_logic_is_reported_and_the_question_is_always_shown(condition):
    document = conditional(condition)
    assert "show_if" not in items(document)[1]
    assert "shown to everybody" in remarks(document, "Q2")


def test_condition_on_a_shuffled_page_is_reported():
    shuffled = block("BL_1", "Q1", "Q2", Options={"RandomizeQuestions": "RandomizeAll"})
    document = conditional(logic(("Q1", "1")), blocks=[shuffled])
    assert definition_of(document).pages[0].order == "shuffled"
    assert "shown to everybody" in remarks(document, "Q2")


# --- names and bounds -----------------------------------------------------------------------------


def test_names_fit_and_are_unique():
    tags = {"Q1": "1. Age?", "Q2": "1 age", "Q3": "A very long name " * 9}
    document = qsf(*(payload(name, "TE", "SL", tag=tag) for name, tag in tags.items()))
    keys = [item["key"] for item in items(document)]
    assert keys[:2] == ["q_1_age", "q_1_age_2"]
    assert len(keys[2]) <= 40


def test_question_that_is_left_out_does_not_take_a_name():
    document = qsf(choice(tag="age", Choices={}), payload("Q2", "TE", "SL", tag="age"))
    assert [item["key"] for item in items(document)] == ["age"]


def test_questions_beyond_the_limit_are_listed():
    draft = read(qsf(*texts(*(f"Q{n}" for n in range(305)))))
    assert len(draft.definition("test", 1).questions()) == 300
    assert left_out(draft) == 5


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (qsf(question("Timing", "PageTimer")), "None of the file's questions"),
        (
            qsf(*(payload(f"Q{n}", "TE", "SL", text="x" * 3900) for n in range(140))),
            "larger than 512 kB",
        ),
        (b'{"SurveyElements": [', "not valid JSON"),
        (b'{"SurveyElements": 3}', "no list"),
        (b'{"SurveyElements": [1]}', "no list"),
        (b'{"SurveyElements": ' + b"[" * 100_000, "not valid JSON"),
    ],
    ids=["nothing to import", "too much text", "cut off", "number", "list of numbers", "nested"],
)
def test_file_that_cannot_be_imported_is_refused_with_the_reason(document, message):
    with pytest.raises(BadDefinitionError, match=message):
        definition_of(document)


def test_text_that_is_too_long_is_shortened_and_reported():
    document = qsf(entry(text="x" * 5000))
    assert len(items(document)[0]["text"]["en"]) == 4000
    assert "shortened" in remarks(document, "Q1")
