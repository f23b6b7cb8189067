"""The one reader of stored states: order, batches, classes."""

import pytest
from django.db import connection
from django.test.utils import CaptureQueriesContext

from experiments import stored_states
from experiments.dataset.states import StoredState
from experiments.stored_states import StateReader, clock_offsets, newest_chunk
from sessions.models import StateChunk
from tests.support.people import person
from tests.support.studies import participants as p

pytestmark = pytest.mark.django_db
STORED = StateReader(StoredState)


def state(seq: int) -> dict:
    return {
        "stamp": 100.0 + seq,
        "seq": seq,
        "pose": {"x": 0.0, "y": 0.0, "theta": 0.0},
        "velocity": {"linear": 0.0, "angular": 0.0},
        "battery": {},
        "ofALaterVersion": True,
    }


def chunk(session, boot: str, seqs: list[int], received_at: float, offset: float | None) -> None:
    StateChunk.objects.create(
        session=session,
        boot=boot,
        first_seq=seqs[0],
        last_seq=seqs[-1],
        count=len(seqs),
        first_stamp=100.0 + seqs[0],
        last_stamp=100.0 + seqs[-1],
        received_at=received_at,
        clock_offset=offset,
        states=[state(seq) for seq in seqs],
    )


def session_at(place: str, name: str):
    study = p.published(p.of("exploration"), slug=name)
    return p.session_of(p.site(place), p.comer(study, person(name)))


@pytest.fixture
def session():
    session = session_at("office", "ada")
    chunk(session, "second", [1, 2], 30.0, 0.2)
    chunk(session, "first", [5], 20.0, None)
    chunk(session, "first", [3, 4], 20.0, 0.1)
    return session


@pytest.mark.parametrize("at_once", [1, 2, 200])
def test_chunks_come_as_they_were_received_however_many_are_read_at_once(
    session, at_once, monkeypatch
):
    monkeypatch.setattr(stored_states, "CHUNKS_AT_ONCE", at_once)
    found = [(one.boot, one.first_seq, one.clock_offset) for one in STORED.chunks_of(session)]
    assert found == [("first", 3, 0.1), ("first", 5, None), ("second", 1, 0.2)]
    assert [state.seq for state in STORED.of(session.pk)] == [3, 4, 5, 1, 2]


def test_offsets_and_the_newest_chunk_are_in_the_same_order(session):
    assert list(clock_offsets(session)) == [0.1, 0.2]
    assert newest_chunk(session).boot == "second"
    assert newest_chunk(session_at("clinic", "bob")) is None


def test_the_newest_states_are_found_without_reading_the_others(session):
    with CaptureQueriesContext(connection) as asked:
        newest_chunk(session)
    with connection.cursor() as cursor:
        cursor.execute(f"EXPLAIN QUERY PLAN {asked[0]['sql']}")
        assert [row[3].partition(" (")[0] for row in cursor.fetchall()] == [
            "SEARCH telepresence_sessions_statechunk USING INDEX states_in_order"
        ]
