"""A study as the files of an export, made one after the other: nothing is held but one session's
record.

To the dataset (experiments/analysis/dataset/folder.py) come the metrics of every session, what the
reader has chosen, and at last the sums of all files: an export without sums was broken off.
"""

from collections.abc import Iterable, Iterator, Sequence
from hashlib import sha256
from typing import Any

from experiments.analysis.dataset.columns import Column
from experiments.analysis.dataset.files import numbers, table, tables
from experiments.analysis.dataset.records import Session
from experiments.analysis.tables.metric_rows import METRIC_TABLE, metric_row
from experiments.dataset.build import ANALYSED, dataset_of
from experiments.dataset.events import events_of
from experiments.dataset.pseudonyms import Pseudonyms
from experiments.dataset.selection import Choice
from experiments.dataset.sessions import drives_of, granted
from experiments.export.mcap import recording
from experiments.models import Drive, Study
from sessions.models import Snapshot

File = tuple[str, Iterable[bytes]]
SUMS = "SHA256SUMS"
IDENTITIES = (
    Column("participant", "", "code of the participant"),
    Column("session", "", "code of the session"),
    Column("user", "", "key of the user's row"),
    Column("username", "", "name of the user"),
    Column("email", "", "address of the user"),
    Column("session_key", "", "key of the session's row"),
    Column("granted", "", "when the robot was granted"),
    Column("address", "", "address of the visitor's network, truncated"),
    Column("user_agent", "", "what the browser said of itself"),
    Column("recruitment", "", "parameters of the link by which the participant came"),
)
READ_ME = """# {title}

Records of the study {slug}, version {version}. `dataset_description.json` tells what each column
of each file means; times are seconds since the robot was granted, by the clock that the column
names. An empty cell or `nan` is a missing value.

All sessions are here, also failed, empty, practice and excluded ones, and those of pilots and bots:
the columns `kind`, `practice`, `outcome` and `excluded` of the sessions tell them apart.

The tables and figures are made from this folder alone by

    python manage.py analyse_study --dataset . --out ../report

`sha256sum -c SHA256SUMS` tells whether every file is as it was written.
"""


def export_files(study: Study, choice: Choice) -> Iterator[File]:
    """Yield the files of an export in order, their sums last. Each must be read before the next one
    is asked for.
    """
    sums: list[str] = []
    for name, parts in _files(study, choice):
        yield name, _summed(name, parts, sums)
    yield SUMS, ["".join(sorted(sums, key=lambda line: line.split("  ", 1)[1])).encode()]


def _summed(name: str, parts: Iterable[bytes], sums: list[str]) -> Iterator[bytes]:
    found = sha256()
    for part in parts:
        found.update(part)
        yield part
    sums.append(f"{found.hexdigest()}  {name}\n")


def _files(study: Study, choice: Choice) -> Iterator[File]:
    drives = list(drives_of(study))
    dataset = dataset_of(study, choice=choice, drives=drives)
    names, definition = Pseudonyms(study.secret), dataset.study
    title = definition.title.get("en") or definition.slug
    yield (
        "README.md",
        [READ_ME.format(title=title, slug=definition.slug, version=definition.version).encode()],
    )
    more = {"metrics": METRIC_TABLE} | ({"identities": IDENTITIES} if choice.identified else {})
    yield from _encoded(tables(dataset, events_of(drives, names, choice), more))
    if choice.identified:
        yield from _encoded(
            [table("identities", map(_identity, dataset.sessions, drives), IDENTITIES)]
        )
    rows: list[list[Any]] = []
    for session, drive in zip(dataset.sessions, drives, strict=True):
        yield from _encoded(numbers("states", session.id, dataset.states(session.id)))
        yield from _encoded(numbers("network", session.id, dataset.network(session.id)))
        rows.append(metric_row(dataset, session, events_of([drive], names, ANALYSED)))
        if choice.mcap:
            begin = granted(drive) if choice.identified else 0.0
            yield (
                f"mcap/session-{session.id}.mcap",
                [recording(dataset, session, events_of([drive], names, choice), begin=begin)],
            )
        if choice.has_snapshots:
            yield from _snapshots(session, drive)
    yield from _encoded([table("metrics", rows, METRIC_TABLE)])


def _snapshots(session: Session, drive: Drive) -> Iterator[File]:
    shots = (
        Snapshot.objects.filter(session=drive.session)
        .order_by("stamp")
        .values_list("jpeg", flat=True)
    )
    for number, jpeg in enumerate(shots.iterator(chunk_size=1), start=1):
        yield f"snapshots/session-{session.id}-{number}.jpg", [bytes(jpeg)]


def _encoded(files: Iterable[tuple[str, Iterable[str]]]) -> Iterator[File]:
    for name, parts in files:
        yield name, (part.encode() for part in parts)


def _identity(session: Session, drive: Drive) -> Sequence[Any]:
    user, visit, device = drive.participant.user, drive.session, drive.session.device or {}
    recruitment = "&".join(
        f"{name}={value}" for name, value in sorted(drive.participant.recruitment.items())
    )
    who = ("", "", "") if user is None else (str(user.pk), user.username, user.email)
    return (
        drive.participant.code,
        session.id,
        *who,
        str(visit.pk),
        drive.granted_at.isoformat(),
        device.get("network", ""),
        device.get("user_agent", ""),
        recruitment,
    )
