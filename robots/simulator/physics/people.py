"""People in a simulated site, as laser, camera and bumpers meet them.

A person is touched like a disc of radius `BODY` and seen by a laser as two legs, which stay within
it. Lengths in metres.
"""

import math
from typing import NamedTuple

import numpy as np

from robots.api.geometry import Pose2D
from robots.world.solids import Floats, Solid, disc, sides

BODY = 0.17
LEG = 0.075
LEG_ASIDE = 0.09  # from the middle of the body to that of a leg
SWING = 0.08  # of a leg ahead or back at the height of a laser, in full stride
FULL_STRIDE = 0.8  # m/s from which on the legs swing so far
HEIGHT = 1.7
CORNERS = 12
LEG_CORNERS = 8
# metres to the corners of that disc: no person walks nearer
TOUCH = BODY / math.cos(math.pi / CORNERS) + 1e-3


class Person(NamedTuple):
    """A person at one moment.

    `x`, `y` in metres of the map; `heading` where the body looks, radians; `stride` the phase of
    the walk in radians, growing by 2 pi with two steps: the left foot is ahead by `sin(stride)` of
    the swing, the right one behind by as much; `look` identifies the person (clothes, hair,
    height); `speed` in m/s.
    """

    x: float
    y: float
    heading: float
    stride: float
    look: int
    speed: float


def legs(people: tuple[Person, ...]) -> Floats:
    """Return the sides (16 n, 4) of n people's legs, counter-clockwise about each leg."""
    middles = []
    for person in people:
        body = Pose2D(person.x, person.y, person.heading)
        ahead = SWING * min(1.0, person.speed / FULL_STRIDE) * math.sin(person.stride)
        middles += [body.apply(ahead, LEG_ASIDE), body.apply(-ahead, -LEG_ASIDE)]
    at = np.array(middles).reshape(-1, 1, 2)
    found: Floats = (_LEG + np.concatenate([at, at], axis=2)).reshape(-1, 4)
    return found


def solid(person: Person) -> Solid:
    """Return a person as something to bump into."""
    return Solid("person", name_of(person), disc(person.x, person.y, 2.0 * BODY, CORNERS), HEIGHT)


def name_of(person: Person) -> str:
    return f"person-{person.look}"


_LEG = sides(disc(0.0, 0.0, 2.0 * LEG, LEG_CORNERS))
