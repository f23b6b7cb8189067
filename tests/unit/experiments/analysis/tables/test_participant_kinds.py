"""Every part of a report on bots names them; a report on participants does not."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.analysis.documents.latex import as_latex
from experiments.analysis.figures.drawing import label_figure
from experiments.analysis.figures.opinions import figure_8b
from experiments.analysis.plan.reporting_sheet import as_markdown
from experiments.analysis.report import reports, write
from experiments.analysis.tables.paper_tables import table_1
from experiments.analysis.tables.people import counted_by_kind, kinds_note, label_kinds, title_of
from experiments.dataset.records import ParticipantRecord
from tests.support.analysis.study_dataset import made_up

SAID = "Simulated participants (bots)"


def people(*kinds):
    return [ParticipantRecord(f"p{n}", kind=kind) for n, kind in enumerate(kinds)]


@pytest.fixture(scope="module")
def made():
    return made_up(np.random.default_rng(91), 3)


@pytest.fixture(scope="module")
def of_bots(made):
    dataset = replace(
        made,
        participants=tuple(replace(one, kind="bot") for one in made.participants),
        sessions=tuple(replace(one, kind="bot") for one in made.sessions),
    )
    (found,) = reports(dataset, ("bot",))
    return found


def test_every_table_and_figure_of_bots_is_called_so(of_bots):
    for table in of_bots.tables:
        if table.name != "software":
            assert table.title.startswith(f"{SAID}: "), table.name
            assert "“Participants” are 3 bots here; bots are programs" in table.notes[0], table.name
            assert SAID in as_latex(table)
    for drawing in of_bots.figures:
        assert drawing.title.startswith(f"{SAID}: ")
        assert drawing.numbers.title == drawing.title
        assert drawing.figure.get_suptitle() == SAID


def test_the_results_in_words_begin_with_whose_they_are(of_bots, tmp_path):
    bare = replace(of_bots, figures=())
    list(write(bare, tmp_path))
    for name in ("results.txt", "results.tex"):
        first = (tmp_path / name).read_text(encoding="utf-8").splitlines()[0]
        assert "are 3 bots here; bots are programs that took part" in first


def test_sheet_counts_all_participants_and_those_of_its_kind(of_bots, made):
    (sheet,) = [table for table in of_bots.tables if table.name == "reporting-sheet"]
    text = as_markdown(sheet)
    assert text.startswith(f"# {SAID}: Reporting sheet\n")
    assert "- in the dataset: 0 participants, 3 bots\n- in this sheet: 3 bots\n" in text


def test_a_table_and_a_figure_of_participants_say_nothing_of_it(made):
    table, drawing = table_1(made), figure_8b(made)
    assert label_kinds(table, made.participants) is table
    assert label_figure(drawing, made.participants) == drawing


@pytest.mark.parametrize(
    ("kinds", "number", "title"),
    [
        ((), "0 participants", ""),
        (("participant",), "1 participant", ""),
        (("bot",), "0 participants, 1 bot", SAID),
        (("pilot", "pilot"), "0 participants, 2 pilots", "Pilots"),
        (
            ("bot", "participant", "pilot"),
            "1 participant, 1 pilot, 1 bot",
            "Participants and pilots and simulated participants (bots)",
        ),
    ],
)
def test_kinds_are_counted_and_named_in_one_order(kinds, number, title):
    assert counted_by_kind(people(*kinds), "participant") == number
    assert title_of(people(*kinds)) == title
    assert bool(kinds_note(people(*kinds))) == bool(title)
