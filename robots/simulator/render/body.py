"""A person's body as rounded limbs in a pose of the walk.

In the body's frame: x forward, y left, z up from the floor, metres. The walk is the usual one of
stick figures: the thighs swing by a sine, the knee of the leg that swings forward is bent, arms
swing against the legs, and the body rises and falls so that the lower foot is always on the floor.
"""

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from robots.simulator.render.materials import Plane, rgb
from robots.world.solids import Floats

SWING = 0.44  # radians of a thigh at the end of a step
SHIRTS = ("#c8453b", "#2f6fa8", "#e3b23c", "#3f8f6b", "#e9e6df", "#7a5aa0", "#d9743a", "#34495e")
COLOURS: dict[str, tuple[str, ...]] = {
    "skin": ("#f0c8a4", "#e2b08a", "#c68d64", "#8d5a3a", "#6b4329"),
    "hair": ("#2a1e17", "#4b3222", "#7a5230", "#b98d4f", "#8f8f8f", "#1b1b1d"),
    "shirt": SHIRTS,
    "trousers": ("#2d3a52", "#4a4a4d", "#6b5a45", "#23272e", "#516b7d"),
    "shoes": ("#2b2522", "#efefec", "#7a4a2a"),
}
Spot = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Limb:
    """A cone from `start` to `end` (3,); `stripes` darkens every other hand's breadth."""

    start: Floats
    end: Floats
    start_radius: float
    end_radius: float
    colour: Plane
    stripes: bool = False


@dataclass(frozen=True, eq=False)
class Look:
    """The appearance of a person; `height` in metres."""

    height: float
    long_hair: bool
    shorts: bool
    stripes: bool
    skin: Plane
    hair: Plane
    shirt: Plane
    trousers: Plane
    shoes: Plane


def look_of(number: int) -> Look:
    """Return the person of a number, always the same one."""
    rng = np.random.default_rng([abs(number), 41])
    colours = {
        part: rgb(choices[int(rng.integers(len(choices)))]) for part, choices in COLOURS.items()
    }
    long_hair = bool(rng.random() < 0.5)
    height = float(rng.uniform(1.60, 1.86))
    shorts, stripes = bool(rng.random() < 0.3), bool(rng.random() < 0.35)
    return Look(height, long_hair=long_hair, shorts=shorts, stripes=stripes, **colours)


def limbs(look: Look, stride: float | None) -> list[Limb]:
    """Return the body `stride` radians into a walk (`Person.stride`), None to stand."""
    left = _leg(look, 1.0, stride)
    right = _leg(look, -1.0, None if stride is None else stride + math.pi)
    parts = [*left, *right, *_torso(look), *_head(look)]
    for side, phase in ((1.0, math.pi), (-1.0, 0.0)):
        parts += _arm(look, side, 0.0 if stride is None else SWING * 0.8 * math.sin(stride + phase))
    lowest = min(
        min(part.start[2] - part.start_radius, part.end[2] - part.end_radius)
        for part in (*left, *right)
    )
    scale, drop = look.height / 1.75, np.array([0.0, 0.0, lowest])
    return [
        replace(
            part,
            start=(part.start - drop) * scale,
            end=(part.end - drop) * scale,
            start_radius=part.start_radius * scale,
            end_radius=part.end_radius * scale,
        )
        for part in parts
    ]


def _leg(look: Look, side: float, stride: float | None) -> list[Limb]:
    swing = 0.0 if stride is None else SWING * math.sin(stride)
    bend = 0.0 if stride is None else 0.85 * max(0.0, math.cos(stride)) + 0.08
    hip = np.array([0.0, 0.085 * side, 0.92])
    knee = hip + 0.43 * np.array([math.sin(swing), 0.0, -math.cos(swing)])
    ankle = knee + 0.41 * np.array([math.sin(swing - bend), 0.0, -math.cos(swing - bend)])
    pitch = 0.4 * (swing - bend) + 0.05
    toe = ankle + np.array([0.15 * math.cos(pitch), 0.012 * side, 0.15 * math.sin(pitch) - 0.025])
    heel = ankle + np.array([-0.035, 0.0, -0.02])
    shin = Limb(knee, ankle, 0.058, 0.043, look.skin if look.shorts else look.trousers)
    return [
        Limb(hip, knee, 0.085, 0.064, look.trousers),
        shin,
        Limb(heel, toe, 0.042, 0.036, look.shoes),
    ]


def _torso(look: Look) -> list[Limb]:
    shirt = partial(_limb, colour=look.shirt, stripes=look.stripes)
    return [
        *(
            shirt((0.0, 0.07 * side, 1.02), (0.0, 0.1 * side, 1.33), 0.105, 0.105)
            for side in (-1.0, 1.0)
        ),
        shirt((0.01, 0.0, 1.0), (0.015, 0.0, 1.32), 0.118, 0.12),
        shirt((0.0, -0.16, 1.4), (0.0, 0.16, 1.4), 0.062, 0.062),
        _limb((0.0, -0.055, 0.95), (0.0, 0.055, 0.95), 0.115, 0.115, look.trousers),
    ]


def _arm(look: Look, side: float, swing: float) -> list[Limb]:
    shoulder = np.array([0.0, 0.2 * side, 1.39])
    elbow = shoulder + 0.28 * np.array([math.sin(swing), 0.12 * side, -math.cos(swing)])
    forward = swing + 0.3 + 0.4 * max(0.0, swing)
    wrist = elbow + 0.24 * np.array([math.sin(forward), 0.0, -math.cos(forward)])
    hand = wrist + 0.07 * np.array([math.sin(forward), 0.0, -math.cos(forward)])
    return [
        Limb(shoulder, elbow, 0.057, 0.046, look.shirt, look.stripes),
        Limb(elbow, wrist, 0.042, 0.034, look.skin),
        Limb(wrist, hand, 0.04, 0.034, look.skin),
    ]


def _head(look: Look) -> list[Limb]:
    skin, dark = look.skin, rgb("#241a16")
    nose, lips = skin * np.float32(0.93), skin * np.array([0.85, 0.55, 0.55], dtype=np.float32)
    parts = [
        _limb((-0.01, 0.0, 1.4), (0.0, 0.0, 1.54), 0.055, 0.05, skin),
        _limb((0.02, 0.0, 1.585), (0.005, 0.0, 1.655), 0.078, 0.094, skin),
        _limb((-0.02, 0.0, 1.655), (-0.005, 0.0, 1.685), 0.102, 0.092, look.hair),
        _limb((0.1, 0.0, 1.605), (0.095, 0.0, 1.63), 0.014, 0.01, nose),
        _limb((0.082, -0.02, 1.562), (0.082, 0.02, 1.562), 0.012, 0.012, lips),
    ]
    for side in (-1.0, 1.0):
        y = 0.033 * side
        parts.append(_limb((0.085, y, 1.638), (0.085, 0.036 * side, 1.64), 0.015, 0.015, dark))
    for side in (-1.0, 1.0) if look.long_hair else ():
        start, end = (-0.045, 0.045 * side, 1.65), (-0.07, 0.05 * side, 1.44)
        parts.append(_limb(start, end, 0.075, 0.06, look.hair))
    return parts


def _limb(
    start: Spot, end: Spot, first: float, last: float, colour: Plane, *, stripes: bool = False
) -> Limb:
    return Limb(np.array(start), np.array(end), first, last, colour, stripes)
