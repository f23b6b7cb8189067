"""Particles, their weights and their number."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from robots.agent.localization.particle_filter import (
    ParticleSet,
    Sampling,
    heaviest_cluster,
    kld_count,
    places,
    scattered,
    uniform,
    wrapped,
)
from tests.support.examples import examples

SAMPLING = Sampling()


def about(
    *poses: tuple[float, float, float],
    each: int = 500,
    place: float = 0.05,
    heading: float = 0.03,
    seed: int = 1,
) -> np.ndarray:
    return scattered(
        np.array(poses), np.full(len(poses), each), place, heading, np.random.default_rng(seed)
    )


def test_particles_at_one_place_need_the_fewest() -> None:
    assert kld_count(np.zeros((50, 3)), SAMPLING) == SAMPLING.fewest


def test_a_wider_spread_needs_more_particles_up_to_the_most() -> None:
    spreads = [about((0.0, 0.0, 0.0), place=place) for place in (0.1, 0.3, 0.8, 5.0)]
    counts = [kld_count(poses, SAMPLING) for poses in spreads]
    assert counts == sorted(counts)
    assert counts[0] < counts[2]
    assert counts[-1] <= SAMPLING.most


def test_drawing_keeps_the_shares() -> None:
    poses = about((0.0, 0.0, 0.0), (5.0, 0.0, 0.0))
    particles = ParticleSet(poses, np.repeat([0.3 / 500, 0.7 / 500], 500))
    drawn = particles.resampled(SAMPLING, np.random.default_rng(2))
    assert (drawn.poses[:, 0] > 2.0).mean() == pytest.approx(0.7, abs=0.02)
    assert drawn.weights.sum() == pytest.approx(1.0)


def test_evidence_moves_weight_and_depletes_the_particles() -> None:
    particles = uniform(np.zeros((100, 3)))
    assert not particles.is_depleted()
    evidence = np.full(100, -1000.0)
    evidence[7] = 0.0
    weighed = particles.reweighted(evidence)
    assert weighed.weights[7] == pytest.approx(1.0)
    assert weighed.is_depleted()


@given(st.lists(st.floats(-1e6, 0.0), min_size=3, max_size=30))
@examples(50, thorough=500)
def test_weights_sum_to_one_with_any_evidence(evidence: list[float]) -> None:
    weighed = uniform(np.zeros((len(evidence), 3))).reweighted(np.array(evidence))
    assert weighed.weights.sum() == pytest.approx(1.0)
    assert (weighed.weights >= 0.0).all()


def test_the_heaviest_cluster_is_found_with_its_share() -> None:
    poses = about((1.0, 2.0, 3.1), (6.0, 2.0, 3.1))
    particles = ParticleSet(poses, np.repeat([0.8 / 500, 0.2 / 500], 500))
    cluster = heaviest_cluster(particles, 0.6, math.radians(30.0))
    assert cluster.mean[:2] == pytest.approx([1.0, 2.0], abs=0.02)
    assert cluster.share == pytest.approx(0.8, abs=0.01)
    assert cluster.covariance[0, 0] == pytest.approx(0.05**2, rel=0.2)


def test_places_have_their_best_particles_and_a_turn_is_another_place() -> None:
    poses = about((0.0, 0.0, 0.0), (3.0, 0.0, 0.0), (3.0, 0.0, math.pi), each=100)
    fits = np.arange(300.0)
    owner, best = places(poses, fits, 0.6, math.radians(30.0))
    assert best.tolist() == [299, 199, 99]
    assert owner.tolist() == [2] * 100 + [1] * 100 + [0] * 100


def test_a_particle_of_nan_is_a_separate_place() -> None:
    owner, best = places(np.array([[0.0, 0.0, 0.0], [math.nan, 0.0, 0.0]]), np.zeros(2), 0.6, 0.5)
    assert sorted(owner.tolist()) == [0, 1]
    assert len(best) == 2


def test_a_cluster_at_180_degrees_has_one_heading() -> None:
    cluster = heaviest_cluster(
        uniform(about((0.0, 0.0, math.pi), heading=0.1)), 0.6, math.radians(30.0)
    )
    assert abs(wrapped(cluster.mean[2:] - math.pi)[0]) < 0.02
    assert cluster.covariance[2, 2] == pytest.approx(0.01, rel=0.2)
