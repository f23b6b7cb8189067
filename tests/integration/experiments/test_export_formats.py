"""What programs for statistics read of an export: a line a participant and condition, files of SPSS
and Stata, and the script for R.
"""

import csv
import io
import json
import math
import os
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pyreadstat
import pytest

from experiments.analysis.metrics.sessions import measure_all
from experiments.analysis.report import reports
from experiments.dataset.counting import attempted, counting
from experiments.dataset.folder import read
from experiments.export.archive import unpacked
from experiments.export.files import export_files
from experiments.extraction.selection import Selection
from experiments.models import Participant
from tests.support.analysis.every_ending import every_ending
from tests.support.analysis.study_dataset import ROBOTS, made_up
from tests.support.studies.studies import cabin
from tests.support.studies.study_rows import put

pytestmark = [pytest.mark.django_db, pytest.mark.long]


@pytest.fixture
def stored():
    """Six participants: a bot, one who withdrew, one who never moved the robot, and an excluded
    drive.
    """
    made = made_up(np.random.default_rng(85), 6)
    sessions = [
        replace(one, first_motion=math.nan) if one.participant == "P002" else one
        for one in made.sessions
    ]
    sessions[0] = replace(sessions[0], excluded="a test drive")
    stored = put(replace(made, sessions=tuple(sessions)))
    Participant.objects.filter(code="P003").update(kind="bot")
    withdrawn = Participant.objects.get(code="P004")
    Participant.objects.filter(pk=withdrawn.pk).update(
        status="withdrawn", withdrawn_step="task", slot=str(withdrawn.pk)
    )
    return stored


@pytest.fixture
def folder(stored, tmp_path):
    choice = Selection(formats=frozenset({"labelled"}))
    list(unpacked(export_files(stored.study, choice), tmp_path))
    return tmp_path


def table(folder, name):
    text = (folder / "data" / f"description-{name}_data.csv").read_text()
    return list(csv.DictReader(io.StringIO(text)))


def test_each_participant_has_a_line_for_each_condition(folder):
    rows = table(folder, "conditions")
    dataset = read(folder)
    people = {one.id: one for one in dataset.participants}
    assert {row["participant"] for row in rows} == {
        who for who, one in people.items() if not one.withdrawn
    }
    assert len({(row["participant"], row["condition"]) for row in rows}) == len(rows)
    numbers = {one.session.id: one.values for one in measure_all(dataset)}
    kept = {one.id for one in counting(dataset).sessions}
    reports = [counting(dataset, (kind,)) for kind in ("participant", "bot")]
    tried = {one.id for report in reports for one in attempted(report)}
    for row in rows:
        own = [
            one
            for one in dataset.sessions
            if (one.participant, one.condition) == (row["participant"], row["condition"])
        ]
        counted = [one for one in own if one.id in kept]
        assert (row["kind"], row["sessions"]) == (people[row["participant"]].kind, str(len(own)))
        assert row["counts"] == str(int(bool(counted)))
        assert bool(row["counts_why"]) is not bool(counted)
        used = [one for one in own if one.id in tried][:1]
        assert row["session"] == (used or own[-1:])[0].id
        assert bool(row["completed"]) is bool(used)
        if used:
            assert float(row["completed"]) == (used[0].outcome == "completed")
        (time,) = [numbers[one.id]["task_time"] for one in used] or [math.nan]
        assert float(row["task_time"] or "nan") == pytest.approx(time, nan_ok=True)


def test_success_in_the_conditions_is_that_of_the_report_when_somebody_comes_back(tmp_path):
    made = every_ending()
    outcomes = {"again-1": "timed_out", "again-2": "completed"}
    sessions = [
        replace(one, outcome=outcomes.get(one.id, one.outcome), number=max(1, one.number))
        for one in made.sessions
    ]
    people = [one for one in made.participants if not one.withdrawn]
    about = {"robots": ROBOTS[:1], "plans": {"cabin": cabin()}}
    stored = put(replace(made, sessions=tuple(sessions), participants=tuple(people), **about))
    list(unpacked(export_files(stored.study, Selection()), tmp_path))
    rows = [row for row in table(tmp_path, "conditions") if row["attempted"] == "1"]
    (back,) = [row for row in rows if row["participant"] == "again"]
    assert (back["outcome"], back["completed"]) == ("timed_out", "0")
    report, _sensitivity = reports(read(tmp_path))
    (compared,) = [one for one in report.tables if one.name == "conditions"]
    (success,) = [row for row in compared.rows if row[0].text == "completed"]
    shown = dict(zip(compared.head, success, strict=True))
    for key in ("all_open", "shut"):
        own = [float(row["completed"]) for row in rows if row["condition"] == key]
        assert shown[f"{key}: n"].text == str(len(own))
        assert shown[f"{key}: mean"].text == f"{np.mean(own):.3f}"


def test_condition_without_a_moved_robot_has_the_reason_why_it_does_not_count(folder):
    rows = {row["participant"]: row for row in table(folder, "conditions")}
    assert (rows["P002"]["counts"], rows["P002"]["counts_why"]) == ("0", "not_driven")
    assert (rows["P003"]["counts"], rows["P003"]["counts_why"]) == ("0", "bot")


def test_every_column_of_the_conditions_is_in_the_code_book(folder):
    book = json.loads((folder / "dataset_description.json").read_text())
    described = {
        one["name"]
        for one in book["variableMeasured"]
        if one["description"].startswith("conditions: ")
    }
    assert set(table(folder, "conditions")[0]) == described
    assert {"experience.overall", "order", "completed", "task_time"} <= described


def test_labelled_files_have_the_rows_of_the_csv_files(folder):
    for name in ("participants", "sessions", "metrics", "conditions"):
        rows = table(folder, name)
        for ending, reader in (("sav", pyreadstat.read_sav), ("dta", pyreadstat.read_dta)):
            frame, about = reader(folder / "labelled" / f"{name}.{ending}")
            assert len(frame) == len(rows)
            if name == "sessions":
                labels = about.variable_value_labels["outcome"]
                described = [labels[code] for code in frame["outcome"]]
                assert described.count("the task was completed") == sum(
                    row["outcome"] == "completed" for row in rows
                )
    assert (folder / "labelled" / "questionnaire-experience.sav").is_file()


@pytest.mark.nightly
@pytest.mark.skipif(shutil.which("Rscript") is None, reason="R is missing: apt install r-base-core")
def test_script_loads_the_dataset_into_r(folder, tmp_path):
    path = folder / "data" / "description-sessions_data.csv"
    text = path.read_text().replace("a test drive", '"\'=a ""test"";\'+drive"')
    path.write_text(text)
    script = r"""
    source("load.R", encoding = "UTF-8")
    study <- load_dataset()
    s <- study$sessions
    stopifnot(is.factor(s$outcome), is.numeric(s$first_frame), is.character(s$id))
    stopifnot(attr(s$outcome, "label") == "how the session ended")
    stopifnot(attr(s$outcome, "labels")[["completed"]] == "the task was completed")
    stopifnot(s$excluded[1] == '=a "test";+drive', sum(is.na(s$excluded)) == nrow(s) - 1)
    stopifnot(attr(study$experience$q1, "labels")[[1]] == -2, is.numeric(study$experience$q1))
    stopifnot(is.character(study$conditions$participant), is.numeric(study$conditions$task_time))
    first <- s$id[!is.na(s$first_frame)][1]
    stopifnot(nrow(load_numbers("states", first)) > 10)
    cat(nrow(s), nrow(study$conditions), mean(study$metrics$path), sep = " ")
    if (requireNamespace("haven", quietly = TRUE)) {
      for (ending in c("sav", "dta")) {
        read <- if (ending == "sav") haven::read_sav else haven::read_dta
        h <- read(file.path("labelled", paste0("sessions.", ending)))
        stopifnot(all(haven::as_factor(h$outcome) ==
                      attr(s$outcome, "labels")[as.character(s$outcome)]))
        stopifnot(attr(h$outcome, "label") == "how the session ended")
      }
      q <- haven::read_sav(file.path("labelled", "questionnaire-experience.sav"), user_na = TRUE)
      stopifnot(!is.null(attr(q$q7, "na_range")))
    }
    """
    done = subprocess.run(
        ["Rscript", "-e", script],
        cwd=folder,
        env=os.environ | {"LC_ALL": "C.UTF-8"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    sessions, conditions, path_mean = done.stdout.split()
    assert int(sessions) == len(table(folder, "sessions"))
    assert int(conditions) == len(table(folder, "conditions"))
    paths = [float(row["path"]) for row in table(folder, "metrics") if row["path"]]
    assert float(path_mean) == pytest.approx(np.mean(paths), rel=1e-6)
