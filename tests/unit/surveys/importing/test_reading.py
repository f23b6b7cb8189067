"""Files of any kind: their format, refusals, and odd values."""

import copy
import json
from typing import Any

import pytest
from hypothesis import given, strategies as st

from surveys.documents import BadDefinitionError
from surveys.importing.formats import FORMATS
from surveys.importing.plain_text import plain
from surveys.importing.reading import MAX_FILE, read, slug_for
from tests.support.studies.survey_files import (
    displays,
    field,
    lime,
    lss,
    payload,
    qsf,
    qsf_document,
    redcap,
)

FRUIT = displays("Apple", "Pear")
SURVEY = qsf_document(
    payload("Q1", "MC", "MAVR", "TX", Choices=FRUIT, Language={"DE": {"Choices": FRUIT}}),
    payload("Q2", "Matrix", "Likert", "SingleAnswer", Choices=FRUIT, Answers=FRUIT),
    payload("Q3", "Slider", "HSLIDER", Choices=FRUIT, Labels=FRUIT),
    payload("Q4", "TE", "FORM", Choices=FRUIT),
    payload("Q5", "RO", "DND", Choices=FRUIT, RecodeValues={"1": "3"}),
    payload("Q6", "SBS", "SBSMatrix", Choices=FRUIT, AdditionalQuestions={"1": {"Answers": FRUIT}}),
    payload("Q7", "Matrix", "Bipolar", Choices=FRUIT, Answers=FRUIT),
    payload("Q8", "MC", "NPS", Choices=[{"Display": "0"}, {"Display": "1"}]),
    payload("Q9", "DB", "TB", DisplayLogic={"0": {"0": {"LeftOperand": "q://Q1/x"}}}),
)
ODD = st.sampled_from([None, True, 0, -1, 1e300, "", "x", "\x00", [], [1], {}, {"1": 2}, [[]]])


def test_each_format_knows_its_own_files_alone():
    files = {
        "qsf": qsf(payload("Q1", "TE", "SL")),
        "lss": lss(lime("S", "Q1")),
        "redcap": redcap(field("a", "text")),
    }
    assert set(files) == set(FORMATS)
    for name, document in files.items():
        assert [one for one, known in FORMATS.items() if known.is_in(document)] == [name]


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (b"PK\x03\x04...", "ZIP archive"),
        (b"", "none of these"),
        (b"name,value\n1,2\n", "none of these"),
        (b'{"a": 1}', "none of these"),
        (b"x" * (MAX_FILE + 1), "larger than 5 MB"),
    ],
)
def test_other_files_are_refused_with_a_clear_message(document, message):
    with pytest.raises(BadDefinitionError, match=message):
        read(document)


def places(value: Any, path: tuple = ()) -> list[tuple]:
    """Return the path of every value inside a JSON value."""
    inner = value.items() if isinstance(value, dict) else enumerate(value)
    found = []
    for key, one in inner:
        found.append((*path, key))
        if isinstance(one, dict | list):
            found += places(one, (*path, key))
    return found


@given(st.sampled_from(places(SURVEY)), ODD)
def test_a_qualtrics_file_with_an_odd_value_anywhere_is_read_or_refused(place, odd):
    survey = copy.deepcopy(SURVEY)
    inner: Any = survey
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = odd
    read_or_refused(json.dumps(survey).encode())


@given(st.text(alphabet="ABC:;15|*LMPRKNDXY?é", min_size=1, max_size=1), st.text(max_size=8), ODD)
def test_a_limesurvey_question_of_any_type_with_odd_attributes_is_read_or_refused(
    letter, text, odd
):
    clean = "".join(sign for sign in text if sign.isprintable()).replace("]]>", "")
    names = ("min_answers", "slider_max", "date_min", "max_num_value_n", "maximum_chars")
    attributes = dict.fromkeys(names, clean or str(odd).replace("\x00", ""))
    read_or_refused(
        lss(
            lime(
                letter,
                clean or "Q1",
                [(clean, clean), ("b", "B", 1)],
                [(clean, "A"), ("2", "")],
                {**attributes, "slider_layout": "1"},
            ),
            lime("S", "Q2", relevance=clean),
        )
    )


@given(st.lists(st.text(max_size=12), min_size=10, max_size=10))
def test_a_redcap_field_with_any_cells_is_read_or_refused(cells):
    names = ("label", "choices", "rule", "least", "most", "branching", "matrix", "annotation")
    kinds = ("text", "radio", "checkbox", "slider", "descriptive")
    rows = [
        field(f"f{n}", kind, **dict(zip(names, cells, strict=False)))
        for n, kind in enumerate(kinds)
    ]
    read_or_refused(redcap(*rows))


def read_or_refused(document: bytes) -> None:
    """Read a file; each of its questions must be reported once."""
    try:
        draft = read(document)
        definition = draft.definition("test", 1)
    except BadDefinitionError as error:
        assert error.problems
        return
    keys = [key for note in draft.report.notes for key in note.keys]
    assert sorted(keys) == sorted(question.key for question in definition.questions())


def test_the_same_file_becomes_the_same_questionnaire():
    document = json.dumps(SURVEY).encode()
    assert read(document).definition("a", 1) == read(document).definition("a", 1)


@pytest.mark.parametrize(
    ("html", "text"),
    [
        ("Plain", "Plain"),
        ("a\n b", "a b"),
        ("<p>One</p><p>Two</p>", "One\nTwo"),
        ("<ul><li>One</li><li>Two</li></ul>", "- One\n- Two"),
        ("1 &lt; 2 &amp; 3&nbsp;4", "1 < 2 & 3 4"),
        ('<a href="https://x.org/a">there</a>', "there (https://x.org/a)"),
        ('<a href="https://x.org/a">https://x.org/a</a>', "https://x.org/a"),
        ('<a href="javascript:x()">there</a>', "there"),
        ("<style>p { }</style>a<script>b()</script>", "a"),
        ("<table><tr><td>a</td><td>b</td></tr></table>", "a b"),
        ("age < 18", "age < 18"),
        ("a\x00b", "a b"),
        ("a<![x[b]]>c", "a c"),
    ],
)
def test_markup_becomes_plain_text(html, text):
    assert plain(html).text == text


@pytest.mark.parametrize(
    ("title", "slug"),
    [
        ("My Survey: 2nd", "my-survey-2nd"),
        ("Encuesta rápida", "encuesta-rapida"),
        ("2024 wave", "survey-2024-wave"),
        ("调查", "survey"),
        ("a" * 50, "a" * 40),
    ],
)
def test_a_title_makes_a_name(title, slug):
    assert slug_for(title) == slug
