"""A rehearsal's findings from the database in which its bots took part."""

from collections import Counter
from collections.abc import Container, Iterable, Iterator
from typing import Any

import numpy as np

from experiments.analysis.figures.drawing import as_svg
from experiments.analysis.report import reports
from experiments.analysis.tables.table import as_csv
from experiments.dataset.counting import counting
from experiments.dataset.records import COUNTING, Dataset
from experiments.definition.schema import StudyDefinition
from experiments.extraction.build import dataset_of
from experiments.models import Drive, ParticipantKind, Study, TaskEvent
from experiments.rehearsal.report import DriveRecord, Findings
from experiments.tasks.engine import TaskEngine
from experiments.tasks.finalization import end
from experiments.tasks.stored_records import offset_of, stored, track_of

TWICE = 0.3  # the share of a drive's records that the check of its replay repeats
# a bot has no WebRTC that would measure them
NEVER_FOR_BOTS = frozenset({"loss", "fps", "bitrate", "freezes", "jitter"})
ALWAYS_RARE = frozenset({"by_map", "by_script", "on_datachannel"})


def findings(study: Study) -> Findings:
    definition = study.as_definition()
    practice = definition.practice_keys
    rows = Drive.objects.filter(participant__study=study, participant__kind=ParticipantKind.BOT)
    drives = rows.select_related("session", "participant__study")
    records = {str(drive.session_id): _record(drive, practice) for drive in drives}
    dataset = counting(dataset_of(study), ("bot",))
    drawn, not_drawn = _draw(dataset)
    different = discrepancies(drives, np.random.default_rng(1))
    return Findings(records, list(_empty(dataset, definition)), drawn, not_drawn, different)


def _record(drive: Drive, practice: Container[str]) -> DriveRecord:
    result: dict[str, Any] = drive.result or {}
    started, ended = result.get("started"), result.get("ended")
    seconds = ended - started if started is not None and ended is not None else None
    outcome, passed = drive.outcome or drive.session.outcome, len(result.get("checkpoints") or ())
    mismatches, is_practice = tuple(drive.mismatches or ()), drive.step in practice
    return DriveRecord(drive.condition, outcome, passed, seconds, mismatches, is_practice)


def _empty(dataset: Dataset, definition: StudyDefinition) -> Iterator[str]:
    """Yield the questions that no bot answered, and the columns without a number in any session."""
    steps = {getattr(step, "questionnaire", "") for step in definition.steps}
    for questionnaire in dataset.questionnaires:
        if questionnaire.slug not in steps:
            continue
        own = [one for one in dataset.responses if one.questionnaire == questionnaire.slug]
        answered = {key for one in own for key, value in one.values.items() if value is not None}
        keys = (question.key for question in questionnaire.questions())
        yield from (f"{questionnaire.slug}.{key}" for key in keys if key not in answered)
    for table, read in (("states", dataset.states), ("network", dataset.network)):
        numbers: Counter[str] = Counter()
        for session in dataset.sessions:
            columns = read(session.id)
            numbers.update({name: np.isfinite(columns[name]).sum() for name in columns.dtype.names})
        expected = numbers.keys() - NEVER_FOR_BOTS - ALWAYS_RARE
        yield from (f"{table}.{name}" for name in expected if not numbers[name])


def _draw(dataset: Dataset) -> tuple[list[str], list[str]]:
    """Draw every table and figure; return their names, and why some could not be drawn."""
    if not dataset.sessions:
        return [], ["tables and figures, because nobody drove"]
    try:
        report = next(one for one in reports(dataset, ("bot",)) if one.name == COUNTING)
        for table in report.tables:
            as_csv(table)
        for figure in report.figures:
            as_svg(figure)
    except (ValueError, KeyError, IndexError, ZeroDivisionError) as error:
        # what numbers can be wrong with; a bug that is none of these is one
        return [], [f"tables and figures, because of {type(error).__name__}: {error}"]
    return [one.name for one in (*report.tables, *report.figures)], []


def discrepancies(drives: Iterable[Drive], rng: np.random.Generator) -> list[str]:
    """Return a sentence for each finalised drive of a task of which a new engine makes something
    else from its states and inputs, in a random order and some of them twice.
    """
    return [sentence for drive in drives if (sentence := _difference(drive, rng))]


def _difference(drive: Drive, rng: np.random.Generator) -> str:
    track = track_of(drive)
    if track is None or drive.settled_at is None:
        return ""
    engine = TaskEngine(track)
    records = list(stored(drive, offset_of(drive)))
    records += [record for record in records if rng.random() < TWICE]
    for index in rng.permutation(len(records)):
        engine.feed(records[index])
    end(engine, drive.session)
    outcome, about = engine.progress.outcome, f"Session {drive.session_id}: a replay"
    if outcome not in {drive.outcome, None}:
        return f"{about} ends as {outcome}, but {drive.outcome} is stored."
    found = [(event.type, event.at, event.data()) for event in engine.events]
    rows = TaskEvent.objects.filter(drive=drive).order_by("number")
    if found == list(rows.values_list("type", "stamp", "data")):
        return ""
    return f"{about} of its task gives events that differ from the stored ones."
