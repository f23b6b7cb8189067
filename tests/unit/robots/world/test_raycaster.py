"""Rays against segments: the matrix against one ray and one segment at a time."""

import math

import numpy as np
from hypothesis import given, strategies as st

from robots.world.raycaster import cast, sweep
from robots.world.sites import load_plan
from robots.world.solids import edges, fixed_solids, inside
from tests.support.examples import examples

SOLIDS = fixed_solids(load_plan("office")[0])
OFFICE = edges(SOLIDS)
beams = st.tuples(st.floats(-9, 9), st.integers(1, 400), st.floats(0.01, 1.0)).map(
    lambda b: (b[0], b[2] * math.tau / b[1], b[1])
)
coordinate = st.floats(-20, 20).map(lambda value: round(value, 3))
segment = st.tuples(coordinate, coordinate, coordinate, coordinate).filter(
    lambda s: math.dist(s[:2], s[2:]) > 0.05
)


def one_ray(x: float, y: float, angle: float, s: tuple[float, float, float, float]) -> float:
    """Solve x + t cos = x0 + u dx, y + t sin = y0 + u dy by Cramer's rule."""
    dx, dy = s[2] - s[0], s[3] - s[1]
    determinant = -math.cos(angle) * dy + math.sin(angle) * dx
    if abs(determinant) < 1e-12:
        return math.inf
    t = (-(s[0] - x) * dy + (s[1] - y) * dx) / determinant
    u = (math.cos(angle) * (s[1] - y) - math.sin(angle) * (s[0] - x)) / determinant
    return t if t >= 0 and 0 <= u <= 1 else math.inf


def grazes(x: float, y: float, angle: float, s: tuple[float, float, float, float]) -> bool:
    """Tell whether a ray runs along a segment, through one of its ends, or begins on it: there
    rounding decides.
    """
    parallel = abs(math.sin(angle) * (s[2] - s[0]) - math.cos(angle) * (s[3] - s[1])) < 1e-9
    ends = [(px - x) * math.sin(angle) - (py - y) * math.cos(angle) for px, py in (s[:2], s[2:])]
    aside = abs((s[2] - s[0]) * (y - s[1]) - (s[3] - s[1]) * (x - s[0]))
    return parallel or min(map(abs, ends)) < 1e-9 or aside < 1e-9


@examples(50, thorough=1500)
@given(
    st.lists(segment, min_size=1, max_size=12),
    coordinate,
    coordinate,
    st.lists(st.floats(-4, 4), min_size=1, max_size=20),
)
def test_all_rays_together_equal_single_rays(
    segments: list, x: float, y: float, angles: list
) -> None:
    ranges, which = cast(np.array(segments), x, y, np.array(angles))
    for angle, distance, index in zip(angles, ranges, which, strict=True):
        each = [one_ray(x, y, angle, s) for s in segments]
        if any(grazes(x, y, angle, s) for s in segments):
            continue
        assert math.isclose(distance, min(each), rel_tol=1e-6, abs_tol=1e-6) or (
            math.isinf(distance) and math.isinf(min(each))
        )
        assert (index == -1) == math.isinf(distance)


def test_rays_in_an_empty_world_are_infinite() -> None:
    ranges, which = cast(np.zeros((0, 4)), 0.0, 0.0, np.array([0.0, 1.0]))
    assert np.isinf(ranges).all()
    assert (which == -1).all()
    assert np.isinf(sweep(np.zeros((0, 4)), 0.0, 0.0, 0.0, 0.1, 5)).all()


def test_the_nearest_of_two_walls_stops_the_ray() -> None:
    walls = np.array([[5.0, -1.0, 5.0, 1.0], [3.0, -1.0, 3.0, 1.0]])
    ranges, which = cast(walls, 0.0, 0.0, np.array([0.0, math.pi]))
    assert ranges[0] == 3.0
    assert which.tolist() == [1, -1]


@examples(50, thorough=1500)
@given(st.floats(-2, 14), st.floats(-2, 9), beams)
def test_a_sweep_equals_single_rays(x: float, y: float, fan: tuple[float, float, int]) -> None:
    if any(inside(solid.outline, np.array(x), np.array(y)) for solid in SOLIDS):
        return
    start, step, count = fan
    angles = start + step * np.arange(count)
    expected, _ = cast(OFFICE, x, y, angles)
    ends = np.arctan2(OFFICE[:, 1] - y, OFFICE[:, 0] - x)
    # at corners rounding decides
    clear = np.array(
        [np.abs((ends - angle + math.pi) % math.tau - math.pi).min() > 1e-5 for angle in angles]
    )
    assert np.allclose(sweep(OFFICE, x, y, start, step, count)[clear], expected[clear], rtol=1e-6)


def test_no_beam_slips_through_a_corner() -> None:
    corner = np.array([[2.0, 0.0, 2.0, -1.0], [1.0, 0.0, 2.0, 0.0], [2.0, 1.0, 2.0, 0.0]])
    for shift in np.linspace(-1e-9, 1e-9, 21):
        assert np.isfinite(sweep(corner, 0.0, 0.0, -0.1 + shift, 0.1, 3)[1])
