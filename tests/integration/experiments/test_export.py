"""A study as files: complete, with sums, without identities; and the same report from them as from
the database.
"""

import csv
import hashlib
import io
import json
import os
import re
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from django.core.management import CommandError, call_command
from django.db import connection
from django.utils import timezone
from mcap.reader import make_reader

from accounts.models import AuditEntry
from experiments.analysis.report import reports
from experiments.dataset.counting import counting
from experiments.dataset.folder import read, write
from experiments.dataset.records import Dataset
from experiments.dataset.states import STATES
from experiments.definition.plan import AttentionCheck, Speeder, StudyPlan
from experiments.definition.schema import as_stored
from experiments.definition.shipped import shipped
from experiments.export.archive import unpacked, zipped
from experiments.export.files import SUMS, export_files, read_me
from experiments.export.formats import FORMATS, ON_REQUEST, UnknownFormatError
from experiments.extraction.pseudonyms import Pseudonyms
from experiments.extraction.selection import Selection
from experiments.models import Draw, Drive, Participant, Study
from experiments.participation.consent import take_back_sharing
from experiments.participation.withdrawal.deletion import withdraw
from sessions.models import StateChunk
from surveys.models import Answer
from surveys.questions.text import TextItem
from tests.support.analysis.study_dataset import made_up
from tests.support.paths import ROOT
from tests.support.studies.study_rows import AGENT, put

pytestmark = [pytest.mark.django_db, pytest.mark.long]


def commented(definition):
    """A questionnaire with a field for words at its end."""
    *pages, last = definition.pages
    last = msgspec.structs.replace(
        last, items=(*last.items, TextItem(key="comment", text={"en": "Anything else?"}))
    )
    return msgspec.structs.replace(definition, pages=(*pages, last))


@pytest.fixture
def stored():
    """A study with four participants, one excluded session, and data that identify participants."""
    made = made_up(np.random.default_rng(81), 4)
    first, *rest = made.sessions
    sessions = (replace(first, excluded="a test drive"), *rest)
    questions = tuple(map(commented, made.questionnaires))
    kept = put(replace(made, sessions=sessions, questionnaires=questions))
    drive = kept.drives[first.id]
    at = drive.granted_at.timestamp()
    device = {"agent": AGENT, "width": 390.0, "at": at + 5.0, "id": str(drive.participant.user_id)}
    for kind, source, data in (
        ("chat", "page", {"text": "I am Zoe of Example Street", "user": "zoequist"}),
        ("opened", "page", device),
        ("operator_message", "server", {"text": "Mind the cat!"}),
        ("estop", "robot", {"detail": "zoequist", "boot": "boot-1"}),
    ):
        when = {"stamp": at + 4.0, "received_at": at + 4.5}
        drive.session.events.create(source=source, type=kind, data=data, **when)
    jpeg = b"\xff\xd8portrait-of-her\xff\xd9"
    drive.session.snapshots.create(action_id="a", stamp=at, sha256="", jpeg=jpeg)
    return kept


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def exported(study, folder: Path, **choice) -> dict[str, bytes]:
    list(unpacked(export_files(study, Selection(**choice)), folder))
    return contents(folder)


def test_export_contains_no_identity_and_no_date(stored, tmp_path):
    files = exported(stored.study, tmp_path)
    del files[SUMS]  # a sum may contain any digits by chance
    every = b"\n".join(name.encode() + content for name, content in files.items())
    secrets = ["secret agent", "10.0.", "Zoe", "zoequist", "2026-05", "Mind the cat"]
    secrets += ["portrait-of-her", stored.study.secret]
    for person in stored.people.values():
        user = person.user
        secrets += [str(person.pk), str(person.user_id), user.username, user.email]
    for drive in stored.drives.values():
        secrets += [str(drive.session_id), str(int(drive.granted_at.timestamp()))[:7]]
    assert [secret for secret in secrets if secret.encode() in every] == []


def test_identified_export_has_everything(stored, tmp_path):
    files = exported(stored.study, tmp_path, identified=True)
    every = b"\n".join(files.values())
    secrets = (b"secret agent", b"10.0.", b"name-of-P000", b"p000@example.org")
    for secret in (*secrets, b"Mind the cat", b"Example Street"):
        assert secret in every, secret
    assert [name for name in files if name.startswith("snapshots/")]
    assert b'"session_key"' in files["dataset_description.json"]


def test_free_text_is_withheld_as_an_answer_that_was_given(stored, tmp_path):
    row = Answer.objects.filter(response__questionnaire__slug="experience", item="q1").first()
    row.pk, row.item, row.value, row.position = None, "comment", "My name is Zoe", 9
    row.save()
    exported(stored.study, tmp_path / "without")
    exported(stored.study, tmp_path / "with", free_text=True)
    without, whole = read(tmp_path / "without").responses, read(tmp_path / "with").responses
    assert [one.missing.get("comment") for one in without].count("withheld") == 1
    given = [one.values["comment"] for one in whole if "comment" in one.values]
    assert given == ["My name is Zoe"]


def test_the_sums_are_those_of_all_files_and_every_column_is_in_the_code_book(stored, tmp_path):
    files = exported(stored.study, tmp_path)
    lines = files.pop(SUMS).decode().splitlines()
    assert dict(reversed(line.split("  ", 1)) for line in lines) == {
        name: hashlib.sha256(content).hexdigest() for name, content in files.items()
    }
    book = files["dataset_description.json"].decode()
    for name, content in files.items():
        if name.endswith("_data.csv"):
            heads = content.decode().split("\n", 1)[0].split(",")
            assert [head for head in heads if f'"{head}"' not in book] == [], name


def test_export_has_all_sessions_also_failed_and_empty_ones(tmp_path):
    made = made_up(np.random.default_rng(82), 4)
    endings = ("connection_refused", "cancelled", "robot_fault", "connection_lost")
    sessions = tuple(
        replace(one, outcome=endings[n % 4], first_motion=float("nan"))
        for n, one in enumerate(made.sessions)
    )
    nothing = Dataset(made.study)
    nothing = {"states": nothing.states, "network": nothing.network, "events": ()}
    stored = put(replace(made, sessions=sessions, **nothing))
    exported(stored.study, tmp_path)
    found = read(tmp_path)
    assert [one.outcome for one in found.sessions] == [one.outcome for one in sessions]
    assert all(len(found.states(one.id)) == 0 for one in found.sessions)
    assert not (tmp_path / "data" / "states").exists()


def test_archive_has_the_files_of_the_folder_and_the_same_bytes_twice(stored, tmp_path):
    files = exported(stored.study, tmp_path)
    first, second = (b"".join(zipped(export_files(stored.study, Selection()))) for _ in range(2))
    assert first == second
    with zipfile.ZipFile(io.BytesIO(first)) as archive:
        assert archive.testzip() is None
        assert {name: archive.read(name) for name in archive.namelist()} == files


def test_archive_has_its_files_in_order_with_parts_of_any_size():
    files = [
        ("a.csv", [b"1,2\n" * n for n in (1, 90_000, 3)]),
        ("empty.csv", []),
        ("data/b.csv", [b"x"]),
    ]
    with zipfile.ZipFile(io.BytesIO(b"".join(zipped(files)))) as archive:
        assert [(name, archive.read(name)) for name in archive.namelist()] == [
            (name, b"".join(parts)) for name, parts in files
        ]


def test_error_while_an_archive_is_made_ends_it():
    def files():
        yield "a.csv", [b"1,2\n" * 90_000]
        raise ValueError("no such session")

    with pytest.raises(ValueError, match="no such session"):
        list(zipped(files()))


def test_participant_who_withdrew_has_one_row_in_an_export(stored, tmp_path):
    withdrawn = stored.people["P001"]
    Participant.objects.filter(pk=withdrawn.pk).update(
        status="withdrawn", withdrawn_step="task", slot=str(withdrawn.pk)
    )
    exported(stored.study, tmp_path)
    found = read(tmp_path)
    (row,) = (one for one in found.participants if one.id == "P001")
    assert (row.withdrawn, row.reached, row.left) == (True, "task", "withdrew")
    assert np.isnan(row.age)
    others = (*found.sessions, *found.responses, *found.pages)
    assert "P001" not in {one.participant for one in others}


def test_bots_and_pilots_are_exported_with_their_kind(stored, tmp_path):
    Participant.objects.filter(code="P000").update(kind="bot")
    exported(stored.study, tmp_path)
    found = read(tmp_path)
    assert {one.participant for one in found.sessions if one.kind == "bot"} == {"P000"}
    assert "P000" not in {one.participant for one in counting(found).sessions}


def test_exported_session_has_whether_it_counts_and_why_not(tmp_path):
    made = made_up(np.random.default_rng(81), 4)
    first, second, third, *rest = made.sessions
    still = {"first_motion": float("nan"), "outcome": "cancelled"}
    excluded = replace(first, excluded="a test drive")
    unexposed = replace(third, first_frame=float("nan"), **still)
    sessions = (excluded, replace(second, **still), unexposed, *rest)
    stored = put(replace(made, sessions=sessions))
    pilot = next(one.participant for one in rest if one.participant != first.participant)
    Participant.objects.filter(code=pilot).update(kind="pilot")
    exported(stored.study, tmp_path)
    found = read(tmp_path)
    whys = [one.counts_why for one in found.sessions]
    assert whys[:3] == ["excluded", "not_driven", "not_exposed"]
    assert {one.counts_why for one in found.sessions if one.participant == pilot} == {"pilot"}
    kept = {one.id for one in found.sessions if one.counts}
    assert {one.session for one in found.responses} > kept
    assert {one.session for one in counting(found).responses} - {""} <= kept
    with (tmp_path / "data/description-sessions_data.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["counts"] for row in rows] == [str(int(not why)) for why in whys]


def test_every_word_of_a_coded_column_is_in_the_code_book(stored, tmp_path):
    files = exported(stored.study, tmp_path)
    book = json.loads(files["dataset_description.json"])
    known, dividers = {}, {}
    for one in book["variableMeasured"]:
        place = one["description"].split(":")[0], one["name"]
        if "valueReference" in one:
            known[place] = {level["value"] for level in one["valueReference"]}
        if divided := re.search(r"words are separated by (.)$", one["description"]):
            dividers[place] = divided[1]
    lists = {"cell", "first_cell", "mismatch", "doors_closed", "problems"}
    assert {name for _, name in dividers} == lists
    assert set(dividers) <= set(known)
    checked = 0
    for name, content in files.items():
        table = re.search(r"(?:description|questionnaire)-(\w+)_data\.csv$", name)
        for row in csv.DictReader(io.StringIO(content.decode())) if table else ():
            for column, cell in row.items():
                words, divider = (which.get((table[1], column)) for which in (known, dividers))
                parts = cell.split(divider) if divider else [cell]
                assert words is None or {"", *words} >= set(parts), (name, column, cell)
                checked += words is not None
    assert checked > 500


def test_a_format_that_is_not_there_is_an_error(stored, tmp_path):
    with pytest.raises(UnknownFormatError, match="no export format parquet"):
        exported(stored.study, tmp_path, formats=frozenset({"parquet"}))
    assert contents(tmp_path) == {}


def test_every_format_on_request_has_a_label_a_help_and_a_role():
    assert {"mcap", "snapshots"} <= set(ON_REQUEST) < set(FORMATS)
    for name, one in ON_REQUEST.items():
        assert one.help.startswith("with ")
        assert not one.is_in(name, Selection())
        assert one.is_in(name, Selection(formats=frozenset({name})))


def test_mcap_reader_reads_the_recording_of_a_session(stored, tmp_path):
    files = exported(stored.study, tmp_path, formats=frozenset({"mcap"}))
    found = read(tmp_path)
    session = next(one for one in found.sessions if len(found.states(one.id)))
    reader = make_reader(io.BytesIO(files[f"mcap/session-{session.id}.mcap"]))
    messages = list(reader.iter_messages())
    topics = [channel.topic for _, channel, _ in messages]
    assert topics.count("/pose") == topics.count("/velocity") == len(found.states(session.id))
    assert topics.count("/network") == len(found.network(session.id))
    assert topics.count("/events") == sum(one.session == session.id for one in found.events)
    assert (topics.count("/path"), topics.count("/course")) == (1, 1)
    poses = {schema.name for schema, channel, _ in messages if channel.topic == "/pose"}
    assert poses == {"foxglove.PoseInFrame"}
    assert max(message.log_time for _, _, message in messages) < 3600 * 10**9


@pytest.mark.nightly
@pytest.mark.django_db(transaction=True)
def test_reports_of_database_and_export_by_three_processes_are_the_same(stored, tmp_path):
    environment = os.environ | {
        "DATABASE_URL": f"sqlite:///{connection.settings_dict['NAME']}",
        "VAR_DIR": str(tmp_path / "var"),
        "HTTP_ONLY": "1",
    }
    study = stored.study.slug

    def manage(*words: str) -> None:
        command = [sys.executable, "manage.py", *words]
        subprocess.run(command, check=True, cwd=ROOT, env=environment, capture_output=True)

    manage("analyse_study", study, "--out", str(tmp_path / "first"))
    manage("export_study", study, "--out", str(tmp_path / "dataset"))
    environment |= {"PYTHONHASHSEED": "3", "TZ": "Asia/Tokyo"}
    environment |= {"DATABASE_URL": "sqlite:////nowhere/at-all.sqlite3"}
    dataset = str(tmp_path / "dataset")
    manage("analyse_study", "--dataset", dataset, "--out", str(tmp_path / "second"))
    first, second = contents(tmp_path / "first"), contents(tmp_path / "second")
    assert len(first) > 60
    assert sorted(first) == sorted(second)
    assert [name for name in first if first[name] != second[name]] == []


def test_a_study_without_participants_is_exported_and_analysed(tmp_path):
    stored = put(Dataset(shipped()["exploration"]))
    dataset, quietly = tmp_path / "dataset", {"stdout": io.StringIO()}
    call_command("export_study", stored.study.slug, out=dataset, **quietly)
    call_command("analyse_study", dataset=dataset, out=tmp_path / "report", **quietly)
    assert not AuditEntry.objects.filter(act="analysis_exported").exists()
    call_command("analyse_study", stored.study.slug, out=tmp_path / "own", **quietly)
    assert AuditEntry.objects.get(act="analysis_exported").thing == "version 1"
    assert read(dataset).sessions == ()
    assert (tmp_path / "report" / SUMS).exists()


def test_readme_of_a_dataset_of_bots_has_the_command_of_its_report(tmp_path):
    made = made_up(np.random.default_rng(7), 2)
    bots = [replace(one, kind="bot") for one in made.participants]
    sessions = [replace(one, kind="bot") for one in made.sessions]
    folder = tmp_path / "dataset"
    write(replace(made, participants=tuple(bots), sessions=tuple(sessions)), folder)
    text = read_me(replace(made, participants=tuple(bots)))
    assert "The dataset is of 2 bots." in text
    assert "--dataset THIS_FOLDER --kind bot --out report" in text
    assert "--dataset THIS_FOLDER --out report" in read_me(made)
    words = ("analyse_study", "--dataset", str(folder), "--out", str(tmp_path / "report"))
    with pytest.raises(CommandError, match="nobody of the kind participant"):
        call_command(*words)
    assert not (tmp_path / "report").exists()
    call_command(*words, "--kind", "bot", stdout=io.StringIO())
    assert (tmp_path / "report" / SUMS).exists()


@pytest.mark.parametrize("bots", [1, 2])
def test_the_reporting_sheets_of_participants_and_of_bots_are_in_an_export(bots, tmp_path):
    made = made_up(np.random.default_rng(7), 2)
    people = [
        replace(one, kind="bot" if n < bots else "participant")
        for n, one in enumerate(made.participants)
    ]
    stored = put(replace(made, participants=tuple(people)))
    text = exported(stored.study, tmp_path)["reporting-sheet.md"].decode()
    sheets = text.split("# Simulated participants (bots): Reporting sheet\n")
    assert len(sheets) == 2
    assert f"- in the dataset: {2 - bots} participant" in sheets[1]
    assert f"- in this sheet: {bots} bot" in sheets[1]
    assert "- drives: 0\n" not in sheets[1]
    assert sheets[0].startswith("# Reporting sheet\n") == (bots == 1)


def test_invalid_options_of_the_command_are_refused_with_a_reason(stored, tmp_path):
    full, new = tmp_path / "full", tmp_path / "new"
    full.mkdir()
    (full / "mine.txt").write_text("mine")
    unknown = "There is no study 'nothing'; there are: exploration:1"
    for command, out, reason in (
        ("export_study nothing", new, unknown),
        ("export_study exploration:9", new, "There is no study 'exploration:9'"),
        ("export_study exploration", full, "already exists: choose another --out"),
        ("analyse_study", new, "either"),
        (f"analyse_study --dataset {full}", new, "study.json"),
    ):
        with pytest.raises(CommandError, match=reason):
            call_command(*command.split(), "--out", str(out))
    assert [path.name for path in full.iterdir()] == ["mine.txt"]


def test_states_without_numbers_are_written_and_read(tmp_path):
    made = made_up(np.random.default_rng(83), 1)
    stored = put(made)
    chunk = StateChunk.objects.filter(session__drive__isnull=False).order_by("first_stamp").first()
    for state in chunk.states:
        state.update(tilt=None, clearance=None)
        del state["visitorSilence"]
    chunk.clock_offset = None
    chunk.save()
    exported(stored.study, tmp_path)
    found = read(tmp_path)
    states = found.states(Pseudonyms(stored.study.secret).session(chunk.session_id))
    for name in ("tilt", "clearance", "visitor_silence", "clock_offset"):
        assert np.isnan(states[name][: len(chunk.states)]).all()
        assert np.isfinite(states[name][len(chunk.states) :]).all()
    assert states.dtype.names == tuple(one.name for one in STATES)


def lines(files: dict[str, bytes], name: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(files[f"data/description-{name}_data.csv"].decode())))


def asking_for_sharing(study: Study) -> Study:
    definition = study.as_definition()
    consent = msgspec.structs.replace(definition.consent, sharing={"en": "May we publish?"})
    whole = msgspec.structs.replace(definition, steps=(consent, *definition.steps[1:]))
    Study.objects.filter(pk=study.pk).update(definition=as_stored(whole))
    return Study.objects.get(pk=study.pk)


def agreed(person: Participant, sharing: bool | None) -> None:
    shown = {"step": "consent", "version": 1, "language": "en", "text": "", "text_sha256": ""}
    person.consents.create(sharing=sharing, agreed_at=person.created_at, **shown)


def test_public_dataset_is_of_those_who_agreed_without_exact_ages_and_devices(stored, tmp_path):
    study = asking_for_sharing(stored.study)
    yes, no, unasked, also = sorted(stored.people.values(), key=lambda one: one.code)
    agreed(yes, True)
    agreed(also, True)
    agreed(no, False)
    for one, age in ((yes, 37), (also, 20)):
        Participant.objects.filter(pk=one.pk).update(age=age)
    whole = exported(study, tmp_path / "whole")
    files = exported(study, tmp_path / "public", public=True)
    people = {row["id"]: row for row in lines(files, "participants")}
    assert set(people) == {yes.code, also.code}
    assert unasked.code not in b"".join(files.values()).decode(errors="replace")
    assert (people[yes.code]["age"], people[yes.code]["age_band"]) == ("", "35–44")
    exact = {row["id"]: row["age"] for row in lines(whole, "participants")}
    assert exact[yes.code] == "37"
    for name in ("sessions", "pages", "answers"):
        assert no.code not in {row["participant"] for row in lines(files, name)}
        assert no.code in {row["participant"] for row in lines(whole, name)}
    for row in lines(files, "sessions"):
        assert (row["os"], row["browser"], row["network"]) == ("", "", "")
    text = files["README.md"].decode()
    assert "It has 2 of the 4 participants; the others did not agree to publishing." in text
    assert "| age_band | 1 | 2 of 2 |" in text
    assert "## Anonymity" not in whole["README.md"].decode()


def test_a_public_export_warns_of_who_did_not_agree_or_was_not_asked(stored, tmp_path):
    def warned(study, folder):
        errors = io.StringIO()
        call_command("export_study", study.slug, "--public", "--out", str(folder), stderr=errors)
        return errors.getvalue()

    assert "The consent did not ask" in warned(stored.study, tmp_path / "unasked")
    text = (tmp_path / "unasked" / "README.md").read_text()
    assert "It has all 4 participants: the consent did not ask about publishing." in text
    study = asking_for_sharing(stored.study)
    for one in stored.people.values():
        agreed(one, True)
    assert "participants" not in warned(study, tmp_path / "all")
    taken_back = next(iter(stored.people.values()))
    take_back_sharing(taken_back)
    assert "has 3 of 4 participants" in warned(study, tmp_path / "some")
    assert taken_back.code not in (tmp_path / "some/data/description-answers_data.csv").read_text()


@pytest.mark.parametrize("asked", [True, False])
def test_public_dataset_has_no_row_of_a_participant_who_withdrew(stored, asked, tmp_path):
    study = asking_for_sharing(stored.study) if asked else stored.study
    refused, *others = stored.people.values()
    for one in (refused, *others):
        agreed(one, one != refused)
    withdraw(refused, timezone.now())
    files = exported(study, tmp_path / "public", public=True)
    assert {row["id"] for row in lines(files, "participants")} == {one.code for one in others}
    readme = files["README.md"].decode()
    assert "It has all 3 participants" in readme
    assert "It has no row of those who withdrew: 1." in readme
    sheet = files["reporting-sheet.md"].decode()
    assert "- joined: 4" in sheet
    assert "- withdrew: 1" in sheet
    flow = next(
        t for one in reports(read(tmp_path / "public")) for t in one.tables if t.name == "flow"
    )
    assert any("no row of those who withdrew: 1" in note for note in flow.notes)


TOO_FAST = Speeder(questionnaire="experience", median_share=0.6)
WRONG = AttentionCheck(questionnaire="experience", item="q1", answer="1")


@pytest.mark.parametrize(
    ("plan", "rule"),
    [
        (StudyPlan(speeders=(TOO_FAST,)), "speeder"),
        (StudyPlan(attention_checks=(WRONG,)), "attention check"),
    ],
)
def test_public_dataset_excludes_whom_the_plan_excludes_in_the_whole_study(plan, rule, tmp_path):
    made = made_up(np.random.default_rng(3), 14)
    stored = put(replace(made, study=msgspec.structs.replace(made.study, plan=plan)))
    study = asking_for_sharing(stored.study)
    for number, one in enumerate(stored.people.values()):
        agreed(one, number % 3 != 0)
    whole = exported(study, tmp_path / "whole")
    public = exported(study, tmp_path / "public", public=True)

    def judged(files):
        names = ("id", "counts", "counts_why")
        return {tuple(row[name] for name in names) for row in lines(files, "sessions")}

    assert judged(public) < judged(whole)
    here = {row["id"] for row in lines(public, "participants")}
    excluded = [row for row in lines(whole, "exclusions") if row["participant"] in here]
    if rule == "attention check":  # whose answer a public dataset may withhold
        assert all("right is 1" in row["value"] for row in excluded)
        excluded = [row | {"value": ""} for row in excluded]
    assert lines(public, "exclusions") == excluded
    assert {row["rule"] for row in excluded} == {rule}
    again = counting(read(tmp_path / "public"))
    counted = {row["id"] for row in lines(public, "sessions") if row["counts"] == "1"}
    assert {one.id for one in again.sessions} == counted


@pytest.mark.parametrize(
    "more", [{"identified": True}, {"free_text": True}, {"formats": frozenset({"snapshots"})}]
)
def test_public_dataset_cannot_have_names_texts_or_photos(more):
    with pytest.raises(ValueError, match="public"):
        Selection(public=True, **more)


def test_every_draw_is_exported_with_what_repeats_it(stored, tmp_path):
    person = next(iter(stored.people.values()))
    about = {"study": stored.study, "participant": person, "kind": "participant", "seed": 7}
    counts = {"giraff_open": 2, "giraff_lab_closed": 1}
    Draw.objects.create(**about, number=1, nth=1, reason="first", cell="giraff_open", counts=counts)
    levels = {"ict.games": "4"}
    Draw.objects.create(**about, number=2, nth=2, reason="again", cell=person.cell, levels=levels)
    Participant.objects.filter(pk=person.pk).update(draws_applied=2)
    files = exported(stored.study, tmp_path / "whole")
    first, second = lines(files, "draws")
    assert (first["participant"], first["reason"], first["seed"]) == (person.code, "first", "7")
    assert json.loads(first["counts"]) == counts
    assert json.loads(second["levels"]) == levels
    assert {row["at"] for row in (first, second)} == {""}
    row = next(one for one in lines(files, "participants") if one["id"] == person.code)
    assert (row["first_cell"], row["draws"]) == ("giraff_open", "2")
    public = exported(stored.study, tmp_path / "public", public=True)
    assert lines(public, "draws")[1]["levels"] == "{}"


def test_flow_has_the_last_stage_of_a_withdrawn_participant(stored, tmp_path):
    person = next(one for one in stored.people.values() if one.drives.exists())
    withdraw(person, timezone.now())
    people = lines(exported(stored.study, tmp_path), "participants")
    (row,) = [one for one in people if one["withdrawn"] == "1"]
    assert row["stage"] == "answered"
    assert row["age_band"] == row["age"] == ""


def test_sessions_have_visit_round_and_versions(stored, tmp_path):
    drive = next(iter(stored.drives.values()))
    versions = {"server": "0.1.0+abc", "agent": "0.2", "definition": stored.study.sha256}
    Drive.objects.filter(pk=drive.pk).update(visit=2, round=1, versions=versions)
    rows = lines(exported(stored.study, tmp_path), "sessions")
    (row,) = [one for one in rows if one["agent_version"]]
    assert (row["visit"], row["round"], row["server_version"]) == ("2", "2", "0.1.0+abc")
    assert (row["definition_version"], row["driver_version"]) == (stored.study.sha256, "")
