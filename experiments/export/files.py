"""A study as the files of an export, made one after the other with one session's record in memory.

Each format defines its files (experiments/export/formats/). The sums of all files are last, so that
an export without sums was interrupted.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from hashlib import sha256

from experiments.analysis.metrics.sessions import measure
from experiments.analysis.tables.people import counted_by_kind
from experiments.analysis.tables.software import PROGRAM, versions
from experiments.dataset.records import Dataset
from experiments.export.anonymity import anonymity
from experiments.export.format import ExportSource, File, text_of
from experiments.export.formats import chosen
from experiments.extraction.build import ANALYSED, dataset_of, release_of
from experiments.extraction.events import events_of
from experiments.extraction.selection import Selection
from experiments.extraction.sessions import drives_of
from experiments.models import Study

SUMS = "SHA256SUMS"


def export_files(study: Study, choice: Selection) -> Iterator[tuple[str, Iterable[bytes]]]:
    """Yield the files of an export, each to be read before the next one; their sums are last."""
    sums: dict[str, str] = {}
    for name, parts in _files(study, choice):
        yield name, _summed(name, parts, sums)
    yield SUMS, ["".join(f"{sums[name]}  {name}\n" for name in sorted(sums)).encode()]


def _summed(name: str, parts: Iterable[str | bytes], sums: dict[str, str]) -> Iterator[bytes]:
    found = sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        found.update(data)
        yield data
    sums[name] = found.hexdigest()


def _files(study: Study, choice: Selection) -> Iterator[File]:
    classes = chosen(choice)
    drives = list(drives_of(study, choice))
    dataset = dataset_of(study, choice=choice, drives=drives)
    text = read_me(dataset)
    if dataset.whole is not None:
        text += anonymity(dataset, dataset.whole)
    yield "README.md", [text]
    tables = (one.tables_of(dataset, drives) for one in classes)
    more = {name: layout for some in tables for name, layout in some.items()}
    source = ExportSource(dataset, drives, release_of(study, choice), more)
    formats = [one(source) for one in classes]
    for one in formats:
        yield from one.of_study()
    for session, drive in zip(dataset.sessions, drives, strict=True):
        events = events_of([drive], replace(source.release, choice=ANALYSED))
        found = measure(dataset, session, events)
        source.measured[session.id] = replace(found, segments=(), positions=found.positions[:0])
        for one in formats:
            yield from one.of_session(session, drive)
    for one in formats:
        yield from one.at_last()


def read_me(dataset: Dataset) -> str:
    definition, missing = dataset.study, ", ".join(dataset.publication.missing)
    kinds = {one.kind for one in dataset.participants}
    others = "" if "participant" in kinds else "".join(f" --kind {one}" for one in sorted(kinds))
    return text_of("readme.md").format(
        people=counted_by_kind(dataset.participants) or "nobody yet",
        kind=others,
        title=definition.title.get("en") or definition.slug,
        slug=definition.slug,
        version=definition.version,
        program=PROGRAM,
        release=versions()[PROGRAM],
        missing=f"\nNot filled in by its owners: {missing}.\n" if missing else "",
    )
