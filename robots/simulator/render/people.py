"""People for the camera: an upright sprite of each body, from the side that the viewer sees and in
the phase of the walk.

A body from the right is the mirror image of the same body from the left, half a walk later; so only
one half is drawn, each sprite when it is first needed.
"""

import math

import numpy as np

from robots.simulator.physics.people import Person
from robots.simulator.render.body import limbs, look_of
from robots.simulator.render.items import Things, gather
from robots.simulator.render.rays import EDGE
from robots.simulator.render.scene import SceneItem
from robots.simulator.render.sprite import DENSITY, draw
from robots.simulator.render.texture_atlas import TextureAtlas, Upright
from robots.world.solids import Floats

PHASES = 12  # of a walk
VIEWS = 9  # from the front to the back
STANDING = -1
SLOWEST = 0.05  # m/s of a walking person
HEADROOM = 0.06  # metres of a sprite above a standing person
NO_PEOPLE = gather(())

Key = tuple[int, int, int]


class Figures:
    """Draws people when they are first seen, and keeps the sprites in `texture_atlas`."""

    def __init__(self, texture_atlas: TextureAtlas) -> None:
        self._atlas = texture_atlas
        self._kept: dict[Key, tuple[Upright, float, float, float]] = {}

    def things(self, people: tuple[Person, ...], origin: Floats) -> Things:
        """Return people as things, as seen from a point (2,)."""
        if not people:
            return NO_PEOPLE
        return gather(tuple(self._item(n, person, origin) for n, person in enumerate(people)))

    def _item(self, number: int, person: Person, origin: Floats) -> SceneItem:
        away = np.array([person.x, person.y]) - origin
        bearing = math.atan2(-away[1], -away[0]) - person.heading
        key, mirrored = chosen(person, bearing)
        upright, left, right, top = self._drawn(key)
        if mirrored:
            left, right = -right, -left
        across = np.array([away[1], -away[0]]) / max(math.hypot(*away.tolist()), EDGE)
        middle = np.array([person.x, person.y])
        return SceneItem(
            group=f"person {number}",
            sides=np.hstack([middle + left * across, middle + right * across])[None],
            bottom=0.0,
            top=top,
            density=DENSITY,
            offsets=np.array(upright.offsets, dtype=np.intp)[:, None],
            columns=np.array(upright.columns, dtype=np.intp)[:, None],
            rows=upright.rows,
            lid=None,
            billboard=False,
            holes=True,
            mirrored=mirrored,
        )

    def _drawn(self, key: Key) -> tuple[Upright, float, float, float]:
        if key not in self._kept:
            number, phase, view = key
            look = look_of(number)
            stride = None if phase == STANDING else phase * 2.0 * math.pi / PHASES
            sprite = draw(limbs(look, stride), view * math.pi / (VIEWS - 1), look.height + HEADROOM)
            upright = self._atlas.upright(sprite.picture)
            self._kept[key] = upright, sprite.left, sprite.right, upright.rows / DENSITY
        return self._kept[key]


def chosen(person: Person, bearing: float) -> tuple[Key, bool]:
    """Return the key of a person's sprite from a bearing in radians, and whether it is mirrored."""
    turned = math.remainder(bearing, 2.0 * math.pi)
    view, mirrored = round(abs(turned) * (VIEWS - 1) / math.pi), turned < 0.0
    if abs(person.speed) < SLOWEST:
        return (person.look, STANDING, view), mirrored
    phase = round(person.stride * PHASES / (2.0 * math.pi)) + (PHASES // 2 if mirrored else 0)
    return (person.look, phase % PHASES, view), mirrored
