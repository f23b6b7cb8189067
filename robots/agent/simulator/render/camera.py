"""Pictures of a scene by casting rays in numpy, some milliseconds each; see lens.py for the
geometry and scene.py for the scene.

A mirror is a window in which everything is drawn once more, from behind the glass.
"""

import math
from collections.abc import Mapping

import numpy as np

from robots.agent.simulator.physics.people import Person
from robots.agent.simulator.render.canvas import Canvas, Image, Walls
from robots.agent.simulator.render.items import Things, before, gather, joined
from robots.agent.simulator.render.lens import Lens, grind
from robots.agent.simulator.render.people import Figures
from robots.agent.simulator.render.rays import EDGE, FAR, Eye
from robots.agent.simulator.render.scene import Builder, Glass, RenderScene
from robots.agent.simulator.render.visibility import NEAR, ItemSight, PictureWindow, look
from robots.api.floorplan import DoorState, FloorPlan
from robots.api.geometry import Pose2D
from robots.world.robot_models import RobotModel
from robots.world.solids import Floats, Opening

KEPT_LENSES = 2
KEPT_DOORS = 8
NOTHING = gather(())
NOWHERE = PictureWindow(0, 0, 0, 0)


class SceneCamera:
    """Draws what a robot sees. Not safe for two threads."""

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
        self._lenses: dict[float, Lens] = {}
        self._doors = {door.name: door for door in plan.doors}
        self._shown: tuple[Pose2D, float, dict[str, Opening], tuple[Person, ...]] | None = None
        self._things: dict[tuple[tuple[str, DoorState], ...], Things] = {}
        self._before: dict[tuple[int, int], Things] = {}

    def lens(self, tilt: float) -> Lens:
        """Return the tables for a head's tilt; the last ones are kept."""
        pitch = round(self.camera.pitch + tilt, 5)
        if pitch not in self._lenses:
            if len(self._lenses) >= KEPT_LENSES:
                del self._lenses[next(iter(self._lenses))]
            self._lenses[pitch] = grind(self.camera, pitch)
        return self._lenses[pitch]

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
        """Draw into `out`, (height * 3 / 2, width), contiguous: Y, U, V; an unchanged scene is not
        drawn again. `tilt` is in radians, positive looks down.
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
        """Paint everything, and return what walls there are."""
        lens, eye, things = self.lens(tilt), self.eye(pose), self._things_with(doors)
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
        if all(isinstance(opening, str) for opening in doors.values()):
            return NOTHING
        return gather(
            tuple(
                self.scene.swinging(self._doors[name], opening)
                for name, opening in doors.items()
                if not isinstance(opening, str)
            )
        )

    def _things_with(self, doors: Mapping[str, Opening]) -> Things:
        """Return everything that rests; the last answers are kept."""
        key = tuple(
            sorted((name, opening) for name, opening in doors.items() if isinstance(opening, str))
        )
        if key not in self._things:
            if len(self._things) >= KEPT_DOORS:
                self._things.clear()
                self._before.clear()
            leaves = [self.scene.leaves[pair] for pair in key if pair in self.scene.leaves]
            self._things[key] = gather((*self.scene.items, *leaves))
        return self._things[key]

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
        start, end = glass.line[:2], glass.line[2:]
        along = (end - start) / math.dist(start, end)
        normal = np.array([-along[1], along[0]])
        away = float((eye.origin - start) @ normal)
        window = _pane(lens, eye, glass) if away > NEAR else NOWHERE
        if window.is_empty:
            return
        directions = eye.directions(lens)
        reach = away / np.maximum(-(directions @ normal), EDGE)
        at = (eye.origin - start) @ along + reach * (directions @ along)
        met = (at >= 0.0) & (at <= math.dist(start, end)) & (reach < walls.reach + NEAR)
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
            joined(self._before_glass(things, glass, normal), body),
            self._figures.things(people, behind.origin),
        )
        self._canvas.paint(lens, behind, look(there, lens, behind, seen.reach, window), stencil)
        self._canvas.paint(
            lens,
            eye,
            [sight.within(window) for sight in sights if (sight.entry[met] < reach[met]).any()],
            stencil,
        )

    def _before_glass(self, things: Things, glass: Glass, normal: Floats) -> Things:
        """Return what does not lie wholly behind a mirror; the last answers are kept."""
        key = (id(things), id(glass))
        if key not in self._before:
            self._before[key] = before(things, glass.line[:2], normal)
        return self._before[key]


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
    if depth.min() < NEAR:
        return PictureWindow(0, lens.height, 0, lens.width)
    return PictureWindow(
        max(0, math.floor(float(v.min()))),
        min(lens.height, math.ceil(float(v.max())) + 1),
        max(0, math.floor(float(u.min())) - 1),
        min(lens.width, math.ceil(float(u.max())) + 2),
    )
