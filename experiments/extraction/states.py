"""The stored states and network samples of a session as columns, read a session at a time. Times
are seconds since the grant, to the microsecond.
"""

from collections.abc import Sequence

import numpy as np
from django.db.models import ExpressionWrapper, F

from experiments.dataset.columns import Columns, Floats
from experiments.dataset.states import (
    NAN,
    StoredSample,
    StoredState,
    network_columns,
    read,
    state_columns,
)
from experiments.extraction.forms import NEAR
from experiments.stored_states import Decoded, StateReader, StoredChunk
from sessions.models import NetworkSample

STORED, SAMPLE = StateReader(StoredState), Decoded(StoredSample)


def states_of(session: object, granted: float) -> Columns:
    """Return the states of a session as STATES, run by run and in order within each; `granted` is
    Unix time in seconds. Times and counts start with the session, because the robot's own would
    identify its other records.
    """
    chunks = list(STORED.chunks_of(session))
    runs = {boot: run for run, boot in enumerate(dict.fromkeys(one.boot for one in chunks))}
    chunks.sort(key=lambda one: (runs[one.boot], one.first_seq))
    first = {one.boot: one for one in reversed(chunks)}
    errors = {boot: _clock_error(chunk) for boot, chunk in first.items()}
    states = [state for chunk in chunks for state in chunk.states]
    lengths = np.array([len(chunk.states) for chunk in chunks], dtype=np.intp)

    def of_each(values: Sequence[float]) -> Floats:
        return np.repeat(np.array(values, dtype=np.float64), lengths)

    error = of_each([errors[one.boot] for one in chunks])
    offsets = [NAN if one.clock_offset is None else one.clock_offset for one in chunks]
    return state_columns(
        states,
        stamp=read(states, "stamp") - (granted + error),
        received=of_each([one.received_at for one in chunks]) - granted,
        clock_offset=of_each(offsets) - error,
        boot=of_each([runs[one.boot] for one in chunks]),
        seq=read(states, "seq") - of_each([first[one.boot].first_seq for one in chunks]),
    )


def _clock_error(chunk: StoredChunk[StoredState]) -> float:
    """Return by how much the clock of a run differs from the server's where it was never set: the
    difference would reveal the date. 0 for any other clock.
    """
    error = chunk.states[0].stamp - chunk.received_at if chunk.states else 0.0
    return error if abs(error) >= NEAR else 0.0


def network_of(session: object, granted: float, clock_offset: float) -> Columns:
    """Return the network samples of a session as NETWORK; `clock_offset` is the page's clock minus
    the server's, in seconds.
    """
    stored = ExpressionWrapper(F("data"), output_field=SAMPLE)
    rows = NetworkSample.objects.filter(session=session).annotate(stored=stored)
    found = list(rows.order_by("stamp", "id").values_list("stamp", "stored"))
    stamps = np.array([stamp for stamp, _ in found])
    return network_columns([sample for _, sample in found], stamps - clock_offset - granted)
