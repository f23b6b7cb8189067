"""Markers of a study: published, recorded, and both over real streams of LSL."""

import datetime
import io
import json
import time
import uuid

import pytest
from django.core.management import CommandError, call_command
from django.utils import timezone

from experiments.coding import store
from experiments.extraction.pseudonyms import Pseudonyms
from experiments.management.commands import stream_markers
from experiments.markers.incoming import ForeignMarker, record
from experiments.markers.outgoing import MarkerSource
from experiments.models import Coding, StepVisit
from sessions.models import SessionEvent
from tests.support.paths import ROOT
from tests.support.people import person
from tests.support.sessions import replays
from tests.support.sessions.site import wait_for

pytestmark = pytest.mark.django_db
SECOND = datetime.timedelta(seconds=1)


@pytest.fixture
def drive():
    """A drive that began ten seconds ago, with states by a clock that is two seconds ahead."""
    granted = timezone.now() - 10 * SECOND
    session = replays.session(replays.cabin_robot(), person("ada"), granted=granted)
    replays.record(session, seconds=5)
    return replays.drive(replays.participant(replays.study(), session.visitor), session)


def began(drive) -> float:
    return drive.granted_at.timestamp()


def published(source: MarkerSource) -> list:
    return [(one.marker.source, one.marker.type, one.marker.t) for one in source.new(time.time())]


def test_each_event_is_a_marker_once_at_the_time_of_the_replay(drive):
    source = MarkerSource("cabin-study", began(drive))
    replays.told(drive.session, 1.0, "driving", source="server")
    replays.told(drive.session, 3.0, "collision", detail="ahead")  # by the robot's clock 5.0
    replays.task_told(drive, 2.0, "checkpoint", number=1)
    assert published(source) == [
        ("server", "driving", 1.0),
        ("task", "checkpoint", 2.0),
        ("robot", "collision", 3.0),
    ]
    drive.events.all().delete()  # the closed record has its events again
    replays.task_told(drive, 2.0, "checkpoint", number=1)
    replays.told(drive.session, 4.0, "ended", source="server", outcome="completed")
    assert published(source) == [("server", "ended", 4.0)]


def test_a_marker_has_what_a_pseudonymous_dataset_has(drive):
    source = MarkerSource("cabin-study", began(drive))
    replays.told(drive.session, 1.0, "operator_message", source="server", text="Hello Ada")
    replays.told(drive.session, 2.0, "estop", detail="by Ada")
    replays.told(drive.session, 3.0, "something new", detail="Ada")
    message, stop = source.new(time.time())
    assert message.at == pytest.approx(began(drive) + 1.0)
    output = json.loads(message.marker.text())
    names = Pseudonyms(drive.participant.study.secret)
    assert output == {
        "type": "operator_message",
        "source": "server",
        "t": 1.0,
        "session": names.session(drive.session_id),
        "participant": drive.participant.code,
    }
    assert "Ada" not in stop.marker.text()


def test_shown_questionnaires_and_finished_codings_are_markers(drive):
    source = MarkerSource("cabin-study", began(drive))
    asking = next(iter(drive.participant.study.as_definition().questionnaire_steps))
    for step in (asking.key, "task"):
        StepVisit.objects.create(
            participant=drive.participant, visit=1, round=0, step=step, began_at=timezone.now()
        )
    study, now = drive.participant.study, timezone.now()
    codes = [{"code": "help", "name": "Help", "kind": "point"}]
    scheme = store.store_scheme(study, store.scheme_from(codes), now)
    coding = store.begin(drive, scheme, person("carl"), now)
    edit = store.EventEdit(
        id=uuid.uuid4(), event=uuid.uuid4(), base=0, code="help", begin=4.5, comment="Ada"
    )
    store.save(coding, [edit], now)
    (shown,) = source.new(time.time())
    assert (shown.marker.type, shown.marker.data["step"]) == ("questionnaire_shown", asking.key)
    Coding.objects.update(done_at=timezone.now())
    (coded,) = source.new(time.time())
    assert coded.at == pytest.approx(began(drive) + 4.5)
    assert (coded.marker.data["coder"], coded.marker.data["code"]) == ("C1", "help")
    assert "Ada" not in coded.marker.text()
    assert source.new(time.time()) == []


def test_a_foreign_marker_is_recorded_with_the_sessions_that_it_falls_into(drive):
    now = time.time()
    assert record("cabin-study", ForeignMarker("eeg", "blink", began(drive) + 2.0), now) == 1
    assert record("cabin-study", ForeignMarker("eeg", "blink", began(drive) - 5.0), now) == 0
    assert record("another-study", ForeignMarker("eeg", "blink", began(drive) + 2.0), now) == 0
    event = SessionEvent.objects.get(source="lab")
    assert (event.type, event.data) == ("marker", {"stream": "eeg", "value": "blink"})
    assert event.stamp == pytest.approx(began(drive) + 2.0)
    assert MarkerSource("cabin-study", began(drive)).new(now) == []  # not sent back


def test_unknown_study_is_named():
    with pytest.raises(CommandError, match="no study nothing"):
        call_command("stream_markers", "nothing")


# --- over real streams ----------------------------------------------------------------------------


class Lab:
    """The command's loop, and a laboratory beside it, in one process on loopback."""

    def __init__(self, monkeypatch) -> None:
        monkeypatch.setenv("LSLAPICFG", str(ROOT / "tests" / "support" / "lsl_api.cfg"))
        from experiments.markers import lsl

        self.lsl, self.key = lsl, uuid.uuid4().hex
        self.output = io.StringIO()
        self.ours = lsl.MarkerInlet(f"ours-{self.key}")
        self.theirs = lsl.MarkerOutlet(f"theirs-{self.key}", self.key)
        outlet = lsl.MarkerOutlet(f"ours-{self.key}", f"ours-{self.key}")
        inlets = [lsl.MarkerInlet(f"theirs-{self.key}")]
        self.loop = stream_markers._Loop("cabin-study", outlet, inlets, self.say)
        self.heard: list[ForeignMarker] = []

    def say(self, text: str) -> None:
        self.output.write(text + "\n")

    def step(self) -> None:
        self.loop.step(time.time())
        self.heard += self.ours.poll()[0]

    def until(self, condition, what: str) -> None:
        def is_so() -> bool:
            self.step()
            return condition()

        wait_for(is_so, 30, what)


@pytest.mark.nightly
def test_markers_are_sent_and_received_and_a_lost_stream_is_found_again(drive, monkeypatch):
    lab = Lab(monkeypatch)
    lab.until(
        lambda: {"is connected."} <= {line[-13:] for line in lab.output.getvalue().splitlines()},
        "the foreign stream",
    )
    lab.until(lambda: "A recorder is connected." in lab.output.getvalue(), "a recorder")
    at = time.time() - began(drive)  # however long it took to get here
    replays.told(drive.session, at, "driving", source="server")
    lab.until(lambda: lab.heard, "the marker of the study")
    assert json.loads(lab.heard[0].text)["type"] == "driving"
    assert lab.heard[0].at == pytest.approx(began(drive) + at, abs=0.05)

    sent = time.time()
    lab.theirs.push("blink", sent)
    lab.until(lambda: SessionEvent.objects.filter(source="lab").exists(), "a foreign marker")
    assert SessionEvent.objects.get(source="lab").stamp == pytest.approx(sent, abs=0.05)

    del lab.theirs
    lab.until(lambda: "is lost. Looking for it" in lab.output.getvalue(), "the loss")
    lab.theirs = lab.lsl.MarkerOutlet(f"theirs-{lab.key}", lab.key)
    lab.until(lambda: "is connected again." in lab.output.getvalue(), "the stream again")
    lab.theirs.push("saccade", time.time())
    lab.until(lambda: SessionEvent.objects.filter(source="lab").count() == 2, "the next marker")
