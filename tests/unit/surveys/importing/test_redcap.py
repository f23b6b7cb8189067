"""REDCap data dictionaries as questionnaires: field types, matrices, branching, annotations."""

import pytest

from surveys.documents import BadDefinitionError
from surveys.importing.reading import read
from surveys.importing.report import ImportOutcome
from tests.support.studies.survey_files import (
    definition_of,
    field,
    items,
    outcomes,
    redcap,
    remarks,
)

YES_NO_MAYBE = "1, Yes | 2, No | 3, Perhaps, or not"


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        (field("a", "text"), {"kind": "text"}),
        (field("a", "notes"), {"kind": "text"}),
        (field("a", "radio", choices=YES_NO_MAYBE), {"kind": "single"}),
        (field("a", "dropdown", choices=YES_NO_MAYBE), {"kind": "single"}),
        (field("a", "checkbox", choices=YES_NO_MAYBE), {"kind": "multiple"}),
        (field("a", "yesno"), {"kind": "single"}),
        (field("a", "truefalse"), {"kind": "single"}),
        (
            field("a", "slider", choices="low | middle | high", most="50"),
            {"kind": "slider", "maximum": 50, "low": {"en": "low"}, "high": {"en": "high"}},
        ),
        (
            field("a", "text", rule="integer", least="18", most="99"),
            {"kind": "number", "minimum": 18, "maximum": 99, "whole": True},
        ),
        (field("a", "text", rule="number_2dp"), {"kind": "number"}),
        (
            field("a", "text", rule="date_dmy", least="2020-01-31", most="today"),
            {"kind": "date", "earliest": "2020-01-31", "latest": "today"},
        ),
    ],
    ids=lambda value: value.get("Field Type"),
)
def test_field_becomes_a_question_of_its_kind(row, expected):
    (item,) = items(redcap(row))
    assert item | expected == item


def test_options_have_the_codes_of_the_dictionary():
    radio, yesno = items(redcap(field("a", "radio", choices=YES_NO_MAYBE), field("b", "yesno")))
    assert radio["options"][2] == {"value": "3", "label": {"en": "Perhaps, or not"}}
    assert [one["value"] for one in yesno["options"]] == ["1", "0"]


def test_the_field_that_names_the_record_is_listed_and_not_asked():
    document = redcap(field("a", "text"))
    assert outcomes(document)["record_id"] is ImportOutcome.LEFT_OUT


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (field("a", "calc", choices="[x] + 1"), "Calculated"),
        (field("a", "file"), "Files"),
        (field("a", "sql", choices="select 1"), "database"),
        (field("a", "text", annotation="@HIDDEN"), "hidden"),
        (field("a", "text", annotation="@CALCTEXT([x])"), "Calculated"),
        (field("a", "descriptive", label=""), "no text"),
        (field("a", "other"), "type other"),
    ],
)
def test_fields_without_counterpart_are_listed_with_a_reason(row, message):
    document = redcap(row, field("b", "text"))
    assert outcomes(document)["a"] is ImportOutcome.LEFT_OUT
    assert message in remarks(document, "a")


def test_required_notes_and_order():
    (item,) = items(
        redcap(
            field(
                *("a", "checkbox"),
                choices="1, One | 2, Two | 99, None of these",
                required="y",
                note="Choose up to two",
                annotation="@NONEOFTHEABOVE='99' @MAXCHECKED=2 @RANDOMORDER",
            )
        )
    )
    assert (item["required"], item["hint"]["en"], item["at_most"], item["order"]) == (
        *(True, "Choose up to two", 2, "shuffled"),
    )
    assert item["options"][2]["alone"] is True


def test_tags_words_and_marks_that_are_not_imported_are_reported():
    document = redcap(
        field(
            *("a", "text"),
            rule="email",
            identifier="y",
            annotation="@READONLY @DEFAULT='x' item is reverse scored",
        )
    )
    found = remarks(document, "a")
    assert all(
        words in found
        for words in ("email", "@DEFAULT, @READONLY", "reverse-scored", "identifying")
    )


def test_fields_of_a_matrix_are_a_grid_under_the_heading_of_the_first():
    answers = "0, Never | 1, Sometimes | 2, Often | 999, Decline to answer"
    common = {"choices": answers, "matrix": "mood", "required": "y"}
    document = redcap(
        field("sad", "radio", header="How often did you feel", **common),
        field("glad", "radio", **common),
        field("after", "text"),
    )
    definition = definition_of(document)
    grid, after = definition.pages[0].items
    assert (grid.kind, grid.key, grid.text["en"]) == ("grid", "mood", "How often did you feel")
    assert [row.key for row in grid.rows] == ["sad", "glad"]
    assert [point.value for point in definition.scales[grid.scale]] == [0, 1, 2]
    assert grid.prefer_not
    assert grid.required
    assert after.key == "after"
    notes = {note.name: note.keys for note in read(document).report.notes}
    assert (notes["sad"], notes["glad"]) == (["sad"], ["glad"])


def test_a_matrix_with_checkboxes_is_asked_field_by_field():
    document = redcap(
        field("a", "checkbox", choices=YES_NO_MAYBE, matrix="m"),
        field("b", "checkbox", choices=YES_NO_MAYBE, matrix="m"),
    )
    assert [item["kind"] for item in items(document)] == ["multiple", "multiple"]


def test_a_matrix_that_is_refused_is_listed_field_by_field():
    unlabelled = "1, | 2, "
    document = redcap(
        field("a", "radio", choices=unlabelled, matrix="x" * 3, label="A" * 10),
        field("b", "text"),
    )
    assert {note.name for note in read(document).report.notes} == {"record_id", "a", "b"}


def branched(logic: str) -> bytes:
    return redcap(
        field("a", "radio", choices=YES_NO_MAYBE),
        field("b", "checkbox", choices=YES_NO_MAYBE),
        field("c", "text", branching=logic),
    )


@pytest.mark.parametrize(
    ("logic", "condition"),
    [
        ("[a] = '1'", {"item": "a", "is": ["1"]}),
        ('[a] = "1" or [a] = "3"', {"item": "a", "is": ["1", "3"]}),
        ("[b(2)] = '1'", {"item": "b", "is": ["2"]}),
    ],
)
def test_branching_on_a_choice_is_a_condition(logic, condition):
    assert items(branched(logic))[-1]["show_if"] == condition


@pytest.mark.parametrize(
    "logic",
    ["[a] = '1' and [a] = '2'", "[a] > 1", "[event-name] = 'x'", "[b(2)] = '0'", "[z] = '1'"],
)
def test_other_branching_is_reported_as_written(logic):
    document = branched(logic)
    assert "show_if" not in items(document)[-1]
    assert logic in remarks(document, "c")


def test_sections_begin_pages_and_forms_have_titles():
    document = redcap(
        field("a", "text"),
        field("b", "text", header="About you"),
        field("c", "text", form="second_form"),
    )
    pages = definition_of(document).pages
    assert [(page.title.get("en", ""), page.items[0].key) for page in pages] == [
        *(("Form one", "a"), ("About you", "b"), ("Second form", "c")),
    ]


def test_one_form_of_several_can_be_chosen_and_the_others_are_listed():
    document = redcap(field("a", "text"), field("b", "text", form="second_form"))
    draft = read(document, language="es", form="second_form")
    definition = draft.definition("test", 1)
    assert [question.key for question in definition.questions()] == ["b"]
    assert definition.title == {"es": "Second form"}
    assert [note.name for note in draft.report.notes] == ["b", "form_one"]
    with pytest.raises(BadDefinitionError, match="form_one, second_form"):
        read(document, form="third")


def test_descriptive_text_keeps_its_lines():
    document = redcap(field("a", "descriptive", label="One\nTwo"), field("b", "text"))
    assert definition_of(document).pages[0].intro == {"en": "One\nTwo"}


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_files_with_other_delimiters_a_byte_order_mark_or_old_letters_are_read(delimiter):
    document = redcap(field("a", "text", label="Größe, in cm"), delimiter=delimiter)
    for one in (document, b"\xef\xbb\xbf" + document, document.decode().encode("cp1252")):
        assert items(one)[0]["text"]["en"] == "Größe, in cm"


def test_lines_without_a_name_are_passed_over():
    document = redcap(field("a", "text"), field("", "", label=""), field("b", "text")) + b"\r\n\r\n"
    assert [item["key"] for item in items(document)] == ["a", "b"]
    assert list(outcomes(document)) == ["record_id", "a", "b"]


def test_sections_too_long_together_are_refused_with_their_page():
    document = redcap(
        field("a", "file", header="x" * 3000),
        field("b", "text", header="y" * 3000),
    )
    with pytest.raises(BadDefinitionError, match=r"page_1.*longer than 4000 characters"):
        items(document)


def test_the_columns_of_an_export_over_the_api_are_understood():
    document = (
        b"field_name,form_name,section_header,field_type,field_label,"
        b"select_choices_or_calculations\n"
        b"record_id,f,,text,Record,\n"
        b'a,f,,radio,How?,"1, Well | 2, Badly"\n'
    )
    assert items(document)[0]["options"][1]["label"] == {"en": "Badly"}


def test_a_file_without_a_needed_column_is_refused():
    with pytest.raises(BadDefinitionError, match="field type"):
        read(b"Variable / Field Name,Form Name,Field Label\na,b,c\n")


def test_a_cell_without_an_end_is_refused():
    document = redcap(field("a", "text")) + b'"' + b"x" * 200_000
    with pytest.raises(BadDefinitionError, match="not a valid CSV"):
        read(document)


# --- remarks, and odd files -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (field("a", "text", rule="number", least="[b] + 1"), "min = [b] + 1"),
        (field("a", "text", rule="number", most="9" * 400), "max = 9999"),
        (field("a", "text", rule="date_ymd", most="[b]"), "max = [b]"),
    ],
)
def test_a_bound_that_cannot_be_checked_is_reported_and_left_out(row, message):
    document = redcap(row)
    (item,) = items(document)
    assert not item.keys() & {"minimum", "maximum", "earliest", "latest"}
    assert message in remarks(document, "a")


def test_a_matrix_of_several_fields_that_is_refused_is_left_out_as_a_whole():
    same = {"choices": "1, Yes | 1, Yes indeed", "matrix": "m"}
    document = redcap(field("a", "radio", **same), field("b", "radio", **same), field("c", "text"))
    assert outcomes(document) == {
        **dict.fromkeys(("record_id", "a", "b"), ImportOutcome.LEFT_OUT),
        "c": ImportOutcome.IMPORTED,
    }
    assert remarks(document, "a") == remarks(document, "b")


def test_matrix_with_some_required_rows_or_a_ranking_is_reported():
    common = {"choices": YES_NO_MAYBE, "matrix": "m"}
    document = redcap(
        field("a", "radio", required="y", ranking="y", header="Rank", **common),
        field("b", "radio", **common),
    )
    (grid,) = items(document)
    assert "required" not in grid
    found = remarks(document, "a")
    assert "all rows are optional" in found
    assert "a column in several rows" in found


def test_a_picture_that_a_section_loses_is_reported():
    document = redcap(field("a", "text", header='About you <img src="x.png">'))
    assert definition_of(document).pages[0].title == {"en": "About you"}
    assert "img" in remarks(document, "Section: a")


def test_the_condition_of_a_descriptive_text_is_reported():
    document = redcap(
        field("a", "radio", choices=YES_NO_MAYBE),
        field("b", "descriptive", branching="[a] = '1'"),
        field("c", "text"),
    )
    assert "shown to everybody" in remarks(document, "b")


@pytest.mark.parametrize("sign", ["\u2028", "\x0c", "\x85", "\x1c"])
def test_a_sign_that_ends_lines_elsewhere_does_not_cut_a_row(sign):
    document = redcap(field("a", "radio", label=f"One{sign}Two", choices="1, Yes | 2, No"))
    (item,) = items(document)
    assert len(item["options"]) == 2
    assert "Two" in item["text"]["en"]
