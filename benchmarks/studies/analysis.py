"""The analysis of a thousand sessions with 1.2 million states, from the files of an exported
dataset to every table and figure.

    python -m benchmarks.studies.analysis [--sessions N]

The dataset is made up by a seeded generator and written first; that is measured too, but is not the
export, which reads a database.
"""

import argparse
import resource
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.table import Figure, keep
from experiments.analysis.report import analyse
from experiments.dataset.columns import Columns
from experiments.dataset.folder import read, write
from experiments.dataset.records import Dataset
from experiments.dataset.states import NO_NETWORK, NO_STATES
from tests.support.analysis.study_dataset import drive, link, made_up

SEED = 20170
ANALYSIS_SECONDS, MEGABYTES = 30.0, 300.0


def large(sessions: int) -> Dataset:
    """Return a study with so many sessions, of about 1,200 states each; states are drawn when they
    are asked for.
    """
    dataset = made_up(np.random.default_rng(SEED), sessions // 2 + 8)
    chosen = dataset.sessions[:sessions]
    places = {session.id: number for number, session in enumerate(chosen)}

    def states(session: str) -> Columns:
        one = chosen[places[session]]
        course = dataset.course(one)
        if one.outcome == "connection_refused" or course is None:
            return NO_STATES
        return drive(course, np.random.default_rng([SEED, places[session]]), speed=0.098).states

    def network(session: str) -> Columns:
        if chosen[places[session]].outcome == "connection_refused":
            return NO_NETWORK
        return link(300.0, np.random.default_rng([SEED, 1, places[session]]))

    kept = {one.id for one in chosen} | {""}
    ended = tuple(replace(one, ended=320.0) for one in chosen)
    events = tuple(
        replace(one, stamp=one.stamp * 3.3) for one in dataset.events if one.session in kept
    )
    responses = tuple(one for one in dataset.responses if one.session in kept)
    return replace(
        dataset, sessions=ended, events=events, responses=responses, states=states, network=network
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=1000)
    wanted = parser.parse_args().sessions
    with tempfile.TemporaryDirectory(prefix="telepresence-analysis-") as folder:
        begun = time.perf_counter()
        write(large(wanted), Path(folder) / "dataset")
        written = time.perf_counter() - begun
        begun = time.perf_counter()
        dataset = read(Path(folder) / "dataset")
        files = analyse(dataset, Path(folder) / "report")
        seconds = time.perf_counter() - begun
        states = sum(len(dataset.states(one.id)) for one in dataset.sessions)
        size = sum(path.stat().st_size for path in files) / 1e6
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    share = max(wanted / 1000.0, 0.25)  # figures cost the same for few sessions
    return keep(
        "analysis",
        [
            Figure("sessions", float(len(dataset.sessions)), ""),
            Figure("states", float(states), ""),
            Figure("dataset made up and written", written, "s"),
            Figure(
                "dataset read, every table and figure written",
                seconds,
                "s",
                ANALYSIS_SECONDS * share,
            ),
            Figure("most memory, both together", peak, "MB"),
            Figure("size of tables and figures", size, "MB"),
        ],
        seed=SEED,
    )


if __name__ == "__main__":
    sys.exit(main())
