"""Frames of a scene by casting rays in numpy, some milliseconds each; see lens.py for the geometry
and scene.py for the scene.

A mirror is a window in which everything is drawn once more, from behind the glass.
"""

import math
from collections.abc import Mapping
from functools import lru_cache, partial

import numpy as np

from robots.api.floorplan import DoorState, FloorPlan
from robots.api.geometry import Pose2D
from robots.simulator.physics.people import Person
from robots.simulator.render.canvas import Canvas, Image, Walls
from robots.simulator.render.items import Things, before, gather, joined
from robots.simulator.render.lens import Lens, grind
from robots.simulator.render.people import Figures
from robots.simulator.render.rays import EDGE, FAR, Eye
from robots.simulator.render.scene import Builder, Glass, RenderScene
from robots.simulator.render.visibility import NEAR, ItemSight, PictureWindow, look
from robots.world.robot_models import RobotModel
from robots.world.solids import Opening

CACHED_LENSES = 2
CACHED_DOORS = 8  # states of the doors
CACHED_MIRRORS = 2  # for each of them
NOTHING = gather(())
NOWHERE = PictureWindow(0, 0, 0, 0)


class SceneCamera:
    """Draws what a robot sees; for one thread."""

    def __init__(self, model: RobotModel, plan: FloorPlan, *, seed: int) -> None:
        """Build the scene; takes a second."""
        self.model, self.camera = model, model.camera
        self.scene: RenderScene = Builder(plan, seed).build(model)
        self._canvas = Canvas(self.scene, model.camera.width, model.camera.height)
        self._body = gather(self.scene.body)
        self._picture: Image = np.zeros(
            (model.camera.height * 3 // 2, model.camera.width), dtype=np.uint8
        )
        self._figures = Figures(self.scene.texture_atlas)
        self._lens = lru_cache(CACHED_LENSES)(partial(grind, model.camera))
        self._at_rest = lru_cache(CACHED_DOORS)(self._things_at_rest)
        self._before_glass = lru_cache(CACHED_DOORS * CACHED_MIRRORS)(self._things_before)
        self._doors = {door.name: door for door in plan.doors}
        self._shown: tuple[Pose2D, float, dict[str, Opening], tuple[Person, ...]] | None = None

    def lens(self, tilt: float) -> Lens:
        return self._lens(round(self.camera.pitch + tilt, 5))

    def eye(self, pose: Pose2D) -> Eye:
        mount = pose.compose(Pose2D(self.camera.x, 0.0, 0.0))
        cosine, sine = math.cos(mount.theta), math.sin(mount.theta)
        return Eye(
            np.array([mount.x, mount.y]), np.array([[cosine, -sine], [sine, cosine]]), self.camera.z
        )

    def render(
        self,
        pose: Pose2D,
        tilt: float,
        doors: Mapping[str, Opening],
        people: tuple[Person, ...],
        out: Image,
    ) -> None:
        """Draw into `out`, (height * 3 / 2, width), contiguous: Y, U, V; an unchanged scene is only
        copied. `tilt` is in radians, positive looks down.
        """
        if self._shown != (pose, tilt, doors, people):
            walls = self._draw_all(pose, tilt, doors, people)
            self._canvas.develop(self._picture)
            for person in people:
                self._canvas.darken(
                    self.lens(tilt), self.eye(pose), walls, (person.x, person.y), self._picture
                )
            self._shown = (pose, tilt, dict(doors), people)
        np.copyto(out, self._picture)

    def _draw_all(
        self, pose: Pose2D, tilt: float, doors: Mapping[str, Opening], people: tuple[Person, ...]
    ) -> Walls:
        """Paint everything, and return the walls that the eye sees."""
        lens, eye = self.lens(tilt), self.eye(pose)
        at_rest = ((name, state) for name, state in doors.items() if isinstance(state, str))
        things = self._at_rest(tuple(sorted(at_rest)))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # rays along a wall
            whole = PictureWindow(0, lens.height, 0, lens.width)
            walls = self._canvas.cast_walls(lens, eye)
            self._canvas.paint_walls(lens, eye, walls, whole, None)
            swinging = self._swinging(doors)
            there = joined(joined(things, swinging), self._figures.things(people, eye.origin))
            sights = look(there, lens, eye, walls.reach, whole)
            self._canvas.paint(lens, eye, sights, None)
            for glass in self.scene.mirrors:
                self._reflect(lens, eye, glass, things, swinging, walls, sights, pose, people)
        return walls

    def _swinging(self, doors: Mapping[str, Opening]) -> Things:
        leaves = tuple(
            self.scene.swinging(self._doors[name], opening)
            for name, opening in doors.items()
            if not isinstance(opening, str)
        )
        return gather(leaves) if leaves else NOTHING

    def _things_at_rest(self, doors: tuple[tuple[str, DoorState], ...]) -> Things:
        leaves = (self.scene.leaves[pair] for pair in doors if pair in self.scene.leaves)
        return gather((*self.scene.items, *leaves))

    def _things_before(self, things: Things, glass: Glass) -> Things:
        """Return the things that are not wholly behind a mirror."""
        return before(things, glass.line[:2], glass.normal)

    def _reflect(
        self,
        lens: Lens,
        eye: Eye,
        glass: Glass,
        things: Things,
        swinging: Things,
        walls: Walls,
        sights: list[ItemSight],
        pose: Pose2D,
        people: tuple[Person, ...],
    ) -> None:
        """Draw a mirror's window, the robot at `pose` included; `sights` may hide the glass."""
        start, normal, along = glass.line[:2], glass.normal, glass.along
        away = float((eye.origin - start) @ normal)
        window = _pane(lens, eye, glass) if away > NEAR else NOWHERE
        if window.is_empty:
            return
        directions = eye.directions(lens)
        reach = away / np.maximum(-(directions @ normal), EDGE)
        at = (eye.origin - start) @ along + reach * (directions @ along)
        met = (at >= 0.0) & (at <= glass.length) & (reach < walls.reach + NEAR)
        if not met.any():
            return
        flip = np.eye(2) - 2.0 * np.outer(normal, normal)
        behind = Eye(
            eye.origin - 2.0 * away * normal,
            flip @ eye.world_from_level,
            eye.height,
            beyond=np.where(met, reach, FAR),
        )
        first, last = behind.rays()
        left, right = lens.columns(np.array([first]), np.array([last]))
        window = window.within(PictureWindow(0, lens.height, int(left[0]), int(right[0])))
        stencil = self._canvas.stencil(
            lens, eye, np.where(met, reach, FAR), (glass.bottom, glass.top), window
        )
        seen = self._canvas.cast_walls(lens, behind)
        self._canvas.paint_walls(lens, behind, seen, window, stencil)
        body = joined(self._body.moved(pose), swinging)
        there = joined(
            joined(self._before_glass(things, glass), body),
            self._figures.things(people, behind.origin),
        )
        self._canvas.paint(lens, behind, look(there, lens, behind, seen.reach, window), stencil)
        self._canvas.paint(
            lens,
            eye,
            [sight.within(window) for sight in sights if (sight.entry[met] < reach[met]).any()],
            stencil,
        )


def _pane(lens: Lens, eye: Eye, glass: Glass) -> PictureWindow:
    """Return the window that holds a mirror."""
    corners = np.repeat(eye.level(glass.line.reshape(2, 2)), 2, axis=0)
    u, v, depth = lens.project(
        corners[:, 0],
        corners[:, 1],
        np.tile([glass.bottom - eye.height, glass.top - eye.height], 2),
    )
    if depth.max() < NEAR:
        return NOWHERE
    whole = PictureWindow(0, lens.height, 0, lens.width)
    if depth.min() < NEAR:
        return whole
    return PictureWindow(
        math.floor(float(v.min())),
        math.ceil(float(v.max())) + 1,
        math.floor(float(u.min())) - 1,
        math.ceil(float(u.max())) + 2,
    ).within(whole)
