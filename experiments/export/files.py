"""A study as the files of an export, made one after the other: nothing is held but one session's
record.

What the files are, each format says (experiments/export/formats/). At last come the sums of all
files: an export without sums was broken off.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from hashlib import sha256

from experiments.analysis.metrics.sessions import measure
from experiments.analysis.tables.people import counted_by_kind
from experiments.analysis.tables.software import PROGRAM, versions
from experiments.dataset.records import Dataset
from experiments.export.anonymity import anonymity
from experiments.export.format import ExportSource, File
from experiments.export.formats import chosen
from experiments.extraction.build import ANALYSED, dataset_of, release_of
from experiments.extraction.events import events_of
from experiments.extraction.people import people_of
from experiments.extraction.selection import Selection
from experiments.extraction.sessions import drives_of
from experiments.models import Study

SUMS = "SHA256SUMS"
READ_ME = """# {title}

Records of the study {slug}, version {version}. `dataset_description.json` explains each
column of each file. Times are seconds since the robot was granted, by the clock that the column
names. An empty cell or `nan` is a missing value.
{missing}
The dataset is of {people}. It contains all sessions, including failed, empty, practice and excluded
ones, and those of pilots and of bots (programs that took part in place of people): the columns
`kind`, `practice`, `outcome` and `excluded` distinguish them. `questionnaires/` has the wording of
each questionnaire, its scales and how it is scored; `study.json` has the study.

For a test, begin with `data/description-conditions_data.csv`: one line per participant and
condition, with task times, scores and `counts`. `load.R` loads all tables into R with labels:
`source("load.R", encoding = "UTF-8"); study <- load_dataset()`. In the CSV files, an apostrophe
precedes text that a spreadsheet would run as a formula; `load.R` removes it.

`sha256sum -c SHA256SUMS` checks that every file is unchanged.

To make the tables and figures from this folder alone, get the source of {program} {release}, which
wrote it, and run in the source's folder, with Python 3.11 or newer,

    python3 -m venv .venv
    .venv/bin/pip install -r requirements.lock
    .venv/bin/python manage.py analyse_study --dataset THIS_FOLDER{kind} --out report

A report is on participants unless `--kind` says otherwise, once for each kind: `pilot`, `bot`. It
has the same bytes again with the same source and the same versions of Python, NumPy, SciPy and
Matplotlib, which its table `software` names.
"""


def export_files(study: Study, choice: Selection) -> Iterator[File]:
    """Yield the files of an export in order, their sums last. Each must be read before the next one
    is asked for.
    """
    sums: list[str] = []
    for name, parts in _files(study, choice):
        yield name, _summed(name, parts, sums)
    yield SUMS, ["".join(sorted(sums, key=lambda line: line.split("  ", 1)[1])).encode()]


def read_me(dataset: Dataset) -> str:
    """Return what an export says to whoever unpacks it."""
    definition, missing = dataset.study, ", ".join(dataset.publication.missing)
    kinds = {one.kind for one in dataset.participants}
    others = "" if "participant" in kinds else "".join(f" --kind {one}" for one in sorted(kinds))
    return READ_ME.format(
        people=counted_by_kind(dataset.participants) or "nobody yet",
        kind=others,
        title=definition.title.get("en") or definition.slug,
        slug=definition.slug,
        version=definition.version,
        program=PROGRAM,
        release=versions()[PROGRAM],
        missing=f"\nNot filled in by its owners: {missing}.\n" if missing else "",
    )


def _about_anonymity(study: Study, dataset: Dataset, choice: Selection) -> str:
    if not choice.public:
        return ""
    everybody = people_of(study, replace(choice, public=False)).count()
    return anonymity(dataset, everybody - len(dataset.participants))


def _summed(name: str, parts: Iterable[bytes], sums: list[str]) -> Iterator[bytes]:
    found = sha256()
    for part in parts:
        found.update(part)
        yield part
    sums.append(f"{found.hexdigest()}  {name}\n")


def _files(study: Study, choice: Selection) -> Iterator[File]:
    classes = chosen(choice)
    drives = list(drives_of(study, choice))
    dataset = dataset_of(study, choice=choice, drives=drives)
    yield "README.md", [(read_me(dataset) + _about_anonymity(study, dataset, choice)).encode()]
    more = {
        name: layout for one in classes for name, layout in one.tables_of(dataset, drives).items()
    }
    source = ExportSource(dataset, drives, release_of(study, choice), more)
    formats = [one(source) for one in classes]
    for one in formats:
        yield from one.of_study()
    for session, drive in zip(dataset.sessions, drives, strict=True):
        events = events_of([drive], replace(source.release, choice=ANALYSED))
        found = measure(dataset, session, events)
        source.measured[session.id] = replace(found, segments=(), way=found.way[:0])
        for one in formats:
            yield from one.of_session(session, drive)
    for one in formats:
        yield from one.at_last()
