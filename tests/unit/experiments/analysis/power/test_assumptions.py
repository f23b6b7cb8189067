"""What is assumed of a measure comes from the plan, from bots, or from the defaults."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.analysis.dataset.records import Dataset, ParticipantRecord, SessionRecord
from experiments.analysis.power import assumptions
from experiments.analysis.power.assumptions import Assumption, assumed, of_bots
from experiments.analysis.power.simulation import simulate
from tests.support.analysis.powered import expected, powered_study


def test_a_plan_says_what_is_expected_and_defaults_say_the_rest():
    study = powered_study(expected=[expected(1, 30.0, sd=60.0), expected(0, 0.0)])
    found = assumed(study, "task_time")
    assert (found.source, found.mean("c1"), found.sd("c0"), found.correlation) == (
        *("plan", 30.0, 60.0),
        0.5,
    )
    default = assumed(powered_study(), "task_time")
    assert (default.source, default.sd("c0"), default.correlation) == ("default", 1.0, 0.5)


def bots(times, kind="bot"):
    """Bots who each finish the task in both conditions in some seconds."""
    people = tuple(ParticipantRecord(f"B{n}", kind=kind) for n in range(len(times)))
    sessions = tuple(
        SessionRecord(
            f"B{n}-c{place}",
            f"B{n}",
            "giraff",
            kind=kind,
            condition=f"c{place}",
            outcome="completed",
            first_motion=1.0,
        )
        for n, pair in enumerate(times)
        for place, _ in enumerate(pair)
    )
    return Dataset(powered_study(), participants=people, sessions=sessions)


@pytest.fixture
def timed(monkeypatch):
    """Task times of drives by session, in place of the states that they would be measured from."""

    def of(times):
        values = {
            f"B{n}-c{at}": time for n, pair in enumerate(times) for at, time in enumerate(pair)
        }
        measured = assumptions.measure_all

        def measure_all(dataset):
            return [
                replace(one, values={**one.values, "task_time": values[one.session.id]})
                for one in measured(dataset)
            ]

        monkeypatch.setattr(assumptions, "measure_all", measure_all)
        return bots(times)

    return of


def test_the_drives_of_bots_give_means_deviations_and_correlation(timed):
    rng = np.random.default_rng(2)
    own = rng.normal(100.0, 12.0, (40, 1))
    times = own + rng.normal(0.0, 6.0, (40, 2)) + np.array([0.0, 20.0])
    found = of_bots(timed(times.tolist()))["task_time"]
    assert found.source == "bots"
    assert found.means == pytest.approx(dict(zip(("c0", "c1"), times.mean(axis=0), strict=True)))
    assert found.sd("c0") == pytest.approx(times[:, 0].std(ddof=1))
    assert found.correlation == pytest.approx(np.corrcoef(times.T)[0, 1])


def test_people_are_no_bots_and_too_few_bots_show_nothing(timed):
    assert of_bots(timed([[90.0, 95.0]])) == {}
    assert of_bots(bots([], "participant")) == {}


def test_bots_say_more_than_the_plan():
    study = powered_study(expected=[expected(1, 0.0)])
    seen = {"task_time": Assumption("bots", {"c0": 100.0, "c1": 130.0}, {"c0": 10.0})}
    assert assumed(study, "task_time", seen) is seen["task_time"]
    found = simulate(study, 20, 50, seed=1, observed=seen)
    assert found.power(0.05) == [(50, 50)]
