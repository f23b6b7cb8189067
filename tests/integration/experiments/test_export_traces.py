"""A pseudonymous export cannot be traced to a person: no file of any format contains the names,
ids, times, hashes and addresses of the database.
"""

import csv
import hashlib
import io
import json
import re
import zipfile
from pathlib import Path

import msgspec
import numpy as np
import pytest

from accounts.models import User
from experiments.coding import store
from experiments.export.archive import unpacked, zipped
from experiments.export.files import export_files
from experiments.export.formats import ON_REQUEST
from experiments.extraction.allow_list import EVENTS
from experiments.extraction.pseudonyms import Pseudonyms
from experiments.extraction.selection import Selection
from experiments.models import Coding, CodingEdit, Drive, Participant, TaskEvent
from robots.api import messages as m
from robots.api.codec import encode
from robots.models import RobotPresence
from sessions import protocol
from sessions.models import Session, SessionEvent, Snapshot
from sessions.recording.builder import RecordBuilder
from sessions.recording.items import ActionItem, EventItem, PageItem, PhotoItem, StateItem
from sessions.recording.store import RecordStore
from tests.support.analysis.filled import Filler, as_stored, kinds
from tests.support.analysis.study_dataset import made_up
from tests.support.media.jpegs import with_metadata
from tests.support.studies.study_rows import put
from tests.support.studies.traces import Known, known, members, traces

pytestmark = [pytest.mark.django_db, pytest.mark.long]
EVERY_FORMAT = frozenset(ON_REQUEST)
AFTER = 12.5  # s after the grant
# The words by which a robot is known in public, and which an export has as well.
PUBLIC = {"series": "giraff", "rca": "OpenMORA"}


def snake(kind: type) -> str:
    return re.sub(r"(?<!^)(?=[A-Z])", "_", kind.__qualname__).lower()[:40]


class Writer:
    """Stores every message in the record of one drive, by the recorder and as rows."""

    def __init__(self, drive: Drive) -> None:
        self.drive, self.session = drive, drive.session
        self.key, self.robot = str(drive.session_id), drive.session.robot.name
        self.now = drive.granted_at.timestamp() + AFTER
        self.fill = Filler(self.now)

    def write_all(self) -> None:
        self.by_the_recorder()
        self.as_rows()
        self.tasks()

    def by_the_recorder(self) -> None:
        """As they come from robot and page."""
        builder = RecordBuilder(RecordStore(), lambda *_: None)
        for item in (*self.of_the_robot(), *self.of_the_page()):
            builder.take(item)
        builder.close_all()
        builder.write()
        assert not builder.counts["foreign_session"] + builder.counts["unknown_session"]
        assert not builder.counts["malformed_report"]

    def of_the_robot(self):
        fill, key, now = self.fill, self.key, self.now
        for kind in sorted(EVENTS["robot"].keys() - {"action"}):
            yield EventItem(self.robot, fill.message(m.Event, session=key, type=kind), now)
        for kind in ("photo", "goto", fill.word()):
            status = fill.message(m.ActionStatus, type=kind)
            yield ActionItem(self.robot, key, status, now)
        jpeg, action = with_metadata(f"{fill.word()} {fill.key()}".encode()), fill.key()
        sha256 = hashlib.sha256(jpeg).hexdigest()
        taken = fill.message(m.Event, session=key, type="photo", action_id=action, sha256=sha256)
        yield EventItem(self.robot, taken, now)
        yield PhotoItem(self.robot, action, jpeg, now)
        result = {"sha256": sha256, "bytes": float(len(jpeg)), "stamp": now + 1.0}
        done = fill.message(
            m.ActionStatus, action_id=action, type="photo", status="FINISHED", result=result
        )
        yield ActionItem(self.robot, key, done, now)
        boot, seq = fill.key(), fill.count()
        for number in range(4):
            state = fill.message(
                m.State, session=key, boot=boot, seq=seq + number, stamp=now, contacts=1
            )
            yield StateItem(self.robot, state, encode(state), now, 0.0)

    def of_the_page(self):
        for kind, listed in EVENTS["page"].items():
            for value in (self.fill.word, self.fill.time, self.fill.key):
                data = {**{name: value() for name in listed}, self.fill.word(): value()}
                yield self.page("page/event", protocol.PageEvent, type=kind, data=data)
        yield self.page("page/event", protocol.PageEvent, type="other")
        yield self.page("page/network", protocol.PageNetwork)

    def page(self, suffix: str, kind: type, **fixed):
        message = msgspec.Raw(encode(self.fill.message(kind, **fixed)))
        report = protocol.PageReport(suffix=suffix, session=self.key, message=message)
        return PageItem(report, self.now)

    def as_rows(self) -> None:
        """Store every message as an event of every source, by its own name and by known names."""
        for source in ("robot", "server", "page"):
            for kind in kinds():
                self.event(source, snake(kind), as_stored(self.fill.message(kind)))
            for kind, listed in EVENTS[source].items():
                self.event(source, kind, self.fill.anything())
                self.event(source, kind, {name: self.fill.anything() for name in listed})
        for name, kind in protocol.NOTICES.items():
            self.event("server", name, as_stored(self.fill.message(kind)))

    def event(self, source: str, kind: str, data: dict) -> None:
        SessionEvent.objects.create(
            session=self.session,
            source=source,
            type=kind,
            stamp=self.now,
            received_at=self.now + 0.05,
            data=data,
        )

    def tasks(self) -> None:
        fill, number = self.fill, 1000
        for kind, listed in (*EVENTS["task"].items(), ("other", {})):
            photo = {"name": fill.key(), "number": 2, "pose": {"x": 1.0, "y": 2.0, "theta": 0.5}}
            for data in (photo, fill.anything(), {name: fill.anything() for name in listed}):
                number += 1
                TaskEvent.objects.create(
                    drive=self.drive, number=number, stamp=self.now, type=kind, data=data
                )


@pytest.fixture(scope="module")
def _made():
    return made_up(np.random.default_rng(91), 3)


@pytest.fixture
def stored(_made):
    """A study in which every column and every message holds something that is recognised."""
    kept = put(_made)
    drive = next(iter(kept.drives.values()))
    writer = Writer(drive)
    fill = writer.fill
    writer.write_all()
    for user in User.objects.all():
        user.username, user.email = fill.word(), f"{fill.word()}@betelgeuse.example"
        user.save()
    User.objects.filter(pk=drive.participant.user_id).update(
        username="zaphod.bb",
        display_name="Zaphod Beeblebrox",
        email="president.zb@betelgeuse.example",
    )
    Participant.objects.filter(pk=drive.participant_id).update(
        recruitment=fill.anything(), completion_code=fill.word()[:20]
    )
    RobotPresence.objects.filter(pk=drive.session.robot_id).update(
        factsheet=as_stored(fill.message(m.Factsheet, **PUBLIC))
    )
    Session.objects.filter(pk=drive.session_id).update(
        outcome_reason=fill.word(),
        terms=fill.anything(),
        summary={**drive.session.summary, **fill.anything()},
        device={
            **fill.anything(),
            "os": fill.word(),
            "browser": fill.word(),
            "network": "198.51.100.0/24",
            "user_agent": fill.word(),
        },
    )
    code(drive, fill)
    report = as_stored(fill.message(m.LabReport))
    Drive.objects.filter(pk=drive.pk).update(
        seed=fill.count(),
        applied={**fill.anything(), "control_network": report, "video_network": report},
        assigned=fill.anything(),
        shown=as_stored(fill.message(protocol.Task)),
        result={**drive.result, **fill.anything()},
        began_with={**fill.anything(), "x": 1.0},
        ended_with={**fill.anything(), "x": 1.0},
    )
    return kept


def code(drive: Drive, fill: Filler) -> None:
    """Two coders' codings of a drive, with words that no dataset may have."""
    codes = [{"code": "help", "name": "Help", "kind": "point"}]
    scheme = store.store_scheme(drive.participant.study, store.scheme_from(codes), drive.granted_at)
    for name in ("coder-one", "coder-two"):
        user = User.objects.create_user(f"{name}-{fill.word()}", password=fill.word())
        coding = store.begin(drive, scheme, user, drive.granted_at)
        event = {"code": "help", "begin": AFTER, "modifiers": fill.anything(), "version": 1}
        CodingEdit.objects.create(
            coding=coding, event=fill.key(), comment=fill.word(), at=drive.granted_at, **event
        )
        Coding.objects.filter(pk=coding.pk).update(done_at=drive.granted_at)


def exported(study, folder: Path, **choice) -> dict[str, bytes]:
    paths = list(unpacked(export_files(study, Selection(**choice)), folder))
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


@pytest.mark.nightly
def test_no_file_contains_a_trace_of_people_and_things_of_the_database(stored, tmp_path):
    everything = known()
    files = exported(stored.study, tmp_path / "folder", formats=EVERY_FORMAT)
    folders = {"data", "mcap", "labelled", "snapshots", "codings", "SHA256SUMS"}
    assert {name.split("/")[0] for name in files} >= folders
    archive = b"".join(zipped(export_files(stored.study, Selection(formats=EVERY_FORMAT))))
    assert traces({**files, "archive.zip": archive}, everything) == []


@pytest.mark.nightly
def test_search_finds_the_traces_in_every_format_of_an_identified_export(stored, tmp_path):
    everything = known()
    files = exported(stored.study, tmp_path, identified=True, formats=EVERY_FORMAT)
    found = traces(files, everything)
    for folder in ("data/", "mcap/", "snapshots/"):
        assert [line for line in found if line.startswith(folder)], folder
    drive = next(iter(stored.drives.values()))
    photo = Snapshot.objects.get(session=drive.session)
    for what in (
        "zaphod.bb",
        "president.zb",
        "198.51.100.0",
        str(drive.session_id),
        photo.action_id,
        photo.sha256,
        "a time",
    ):
        assert [line for line in found if what in line], what


def test_a_search_sees_through_archives_and_spellings():
    key = "0b6c1a52-52f0-4d5c-9f3e-1f0f9d0c7a11"
    everything = Known(times=[1.7778852e9])
    everything.add("key", key)
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.txt", f"1777885200123 {key.upper()}")
    files = {"one.zip": packed.getvalue(), f"{key}.csv": b""}
    assert len(traces(files, everything)) == 3
    assert [name for name, _ in members("one.zip", packed.getvalue())][-1] == "one.zip/a.txt"


def rows(files: dict[str, bytes], name: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(files[f"data/description-{name}_data.csv"].decode())))


def test_export_has_the_data_that_researchers_need(stored, tmp_path):
    files = exported(stored.study, tmp_path, formats=EVERY_FORMAT)
    events = [{**row, "data": json.loads(row["data"])} for row in rows(files, "events")]
    (photo,) = (
        one
        for one in events
        if one["type"] == "action" and one["data"].get("result", {}).get("bytes", 0) > 100
    )
    assert photo["data"]["status"] == "FINISHED"
    assert photo["data"]["result"]["stamp"] == pytest.approx(AFTER + 1.0, abs=0.5)
    assert float(photo["stamp"]) == pytest.approx(AFTER, abs=1.0)
    assert re.fullmatch(r"X\w{10}", photo["data"]["actionId"])
    kept = next(one for one in events if one["type"] == "photo_kept" and one["data"].get("pose"))
    assert kept["data"]["pose"] == {"x": 1.0, "y": 2.0, "theta": 0.5}
    coded = rows(files, "coded")
    assert [(one["coder"], one["code"], one["begin"]) for one in coded] == [
        ("C1", "help", "12.5"),
        ("C2", "help", "12.5"),
    ]
    assert {one["comment"] for one in coded} == {""}
    figures = {one["figure"]: one["value"] for one in rows(files, "agreement")}
    assert float(figures["alpha"]) == float(figures["kappa"]) == 1.0
    own = [name for name in files if name.startswith("data/states/")]
    assert own
    for name in own:
        states = list(csv.DictReader(io.StringIO(files[name].decode())))
        assert {int(one["seq"]) for one in states if one["boot"] == "0"} >= {0, 1, 2}
        assert all(abs(float(one["stamp"])) < 3600.0 for one in states)


def test_clock_that_counts_from_1970_does_not_reveal_the_date(stored, tmp_path):
    drive = list(stored.drives.values())[1]
    begin = drive.granted_at.timestamp()
    for chunk in drive.session.chunks.all():
        for state in chunk.states:
            state["stamp"] -= begin
        chunk.clock_offset -= begin
        chunk.save()
    SessionEvent.objects.create(
        session=drive.session, source="robot", type="docked", stamp=3.0, received_at=begin + 3.0
    )
    code = Pseudonyms(stored.study.secret).session(drive.session_id)
    files = exported(stored.study, tmp_path)
    (docked,) = (
        row
        for row in rows(files, "events")
        if row["session"] == code and (row["source"], row["type"]) == ("robot", "docked")
    )
    assert float(docked["stamp"]) == pytest.approx(3.0, abs=0.5)
    for row in csv.DictReader(io.StringIO(files[f"data/states/session-{code}_data.csv"].decode())):
        assert abs(float(row["stamp"])) < 3600.0
        assert abs(float(row["clock_offset"])) < 3600.0
