"""Figures 6 and 7 of the paper: the workspace with the suggested paths, and the trajectories that
were driven, a panel a robot.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.analysis.dataset.records import Dataset, Floats
from experiments.analysis.figures.drawing import DASHES, INK, ROBOTS, WIDTH, Drawing, house_style
from experiments.analysis.figures.floor import BELOW, draw_checkpoint, draw_dock, draw_plan, thinned
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.tables.table import Table, amount, count, number, words
from experiments.definition.feasibility import dock_of
from experiments.definition.schema import Course

PANELS = "abcdefghijklmnop"


def figure_6(dataset: Dataset, site: str) -> Drawing:
    """Return the workspace of a site with each course's checkpoints and suggested path."""
    courses = [course for course in dataset.study.courses if course.site == site]
    title = "Schematic map of the robot workspace with the suggested paths and the charging points."
    with house_style():
        figure = Figure(figsize=(WIDTH, _height(dataset, site, 1)), layout="constrained")
        axes = figure.subplots()
        if site in dataset.plans:
            draw_plan(axes, dataset.plans[site])
        for index, course in enumerate(courses):
            _draw_course(axes, dataset, course, index)
        if courses:
            figure.legend(
                *axes.get_legend_handles_labels(),
                loc="outside lower center",
                ncols=3,
                handlelength=3.0,
            )
    rows = tuple(
        (
            words(course.robot),
            words(site),
            words("checkpoint"),
            count(stop.number),
            number(stop.x),
            number(stop.y),
        )
        for course in courses
        for stop in course.checkpoints
    ) + tuple(
        (words(course.robot), words(site), words("path"), count(index), number(x), number(y))
        for course in courses
        for index, (x, y) in enumerate(course.path)
    )
    return Drawing(
        f"figure-6-{site}",
        title,
        figure,
        Table(f"figure-6-{site}", title, ("robot", "site", "what", "number", "x", "y"), rows),
    )


def _draw_course(axes: Axes, dataset: Dataset, course: Course, index: int) -> None:
    colour, dash = ROBOTS[index % len(ROBOTS)], DASHES[index % len(DASHES)]
    name = next((one.title for one in dataset.robots if one.series == course.robot), course.robot)
    points = np.array(
        course.path or [(stop.x, stop.y) for stop in (*course.checkpoints, course.checkpoints[0])]
    )
    axes.plot(
        points[:, 0],
        points[:, 1],
        color=colour,
        linestyle=dash,
        linewidth=1.6,
        label=f"suggested path of {name}",
        zorder=5,
        gid=f"path-{course.robot}",
    )
    plan = dataset.plans.get(course.site)
    dock = dock_of(course, plan) if plan is not None else None
    if dock is not None:
        draw_dock(axes, dock, name, colour)
    for stop in course.checkpoints:
        draw_checkpoint(axes, stop, colour)


def figure_7(dataset: Dataset, measured: Sequence[Measured]) -> Drawing:
    """Return all trajectories over the floor plan, a panel a robot and site; one robot or none is a
    figure as well.
    """
    known = [(course.site, course.robot) for course in dataset.study.courses]
    series = {one.session.id: dataset.robot(one.session.robot).series for one in measured}
    driven = {(one.session.site, series[one.session.id]) for one in measured if len(one.way)}
    panels = [panel for panel in known if panel in driven] + sorted(driven - set(known)) or known[
        :1
    ]
    title = "Trajectories followed by the robots."
    behind: dict[str, tuple[str, ...]] = {}
    ways = {one.session.id: thinned(one.way) for one in measured}
    with house_style():
        height = sum(_height(dataset, site, 1) for site, _ in panels) or 3.0
        figure = Figure(figsize=(WIDTH, height), layout="constrained")
        axes = figure.subplots(max(1, len(panels)), 1, squeeze=False)[:, 0]
        for index, ((site, robot), panel) in enumerate(zip(panels, axes, strict=False)):
            own = [
                found
                for found in measured
                if (found.session.site, series[found.session.id]) == (site, robot)
                and len(found.way)
            ]
            behind |= _draw_panel(
                panel,
                dataset,
                [(one, ways[one.session.id]) for one in own],
                (site, robot),
                PANELS[index % len(PANELS)],
            )
        if not panels:
            axes[0].axis("off")
    rows = tuple(
        (
            words(one.session.id, (one.session.id,)),
            words(one.session.robot),
            words(one.session.outcome),
            number(float(x), 3),
            number(float(y), 3),
        )
        for one in measured
        for x, y in ways[one.session.id].tolist()
    )
    return Drawing(
        "figure-7",
        title,
        figure,
        Table("figure-7", title, ("session", "robot", "outcome", "x", "y"), rows),
        behind,
    )


def _draw_panel(
    axes: Axes,
    dataset: Dataset,
    own: Sequence[tuple[Measured, Floats]],
    where: tuple[str, str],
    letter: str,
) -> dict[str, tuple[str, ...]]:
    site, robot = where
    if site in dataset.plans:
        draw_plan(axes, dataset.plans[site], furniture=False)
    colour = ROBOTS[
        [one.series for one in dataset.robots].index(robot) % len(ROBOTS)
        if robot in {one.series for one in dataset.robots}
        else 0
    ]
    for found, way in own:
        axes.plot(
            way[:, 0],
            way[:, 1],
            color=colour,
            linewidth=0.5,
            alpha=_faintness(len(own)),
            zorder=2.5,
            gid=f"session-{found.session.id}",
        )
    course = next((one for one in dataset.study.courses if (one.site, one.robot) == where), None)
    for stop in course.checkpoints if course else ():
        draw_checkpoint(axes, stop, INK)
    name = next((one.title for one in dataset.robots if one.series == robot), robot)
    people = len({found.session.participant for found, _ in own})
    behind = f"{amount(len(own), 'session')} of {amount(people, 'participant')}"
    axes.set_title(f"({letter}) {name}: {behind}", loc="left")
    return {f"session-{found.session.id}": (found.session.id,) for found, _ in own}


def _faintness(lines: int) -> float:
    """Many lines are faint, so that where most went is dark."""
    return float(np.clip(6.0 / max(1, lines) ** 0.6, 0.12, 0.9))


def _height(dataset: Dataset, site: str, panels: int) -> float:
    plan = dataset.plans.get(site)
    if plan is None:
        return 3.0 * panels
    corners = np.array([point for room in plan.rooms for point in room.polygon])
    width, height = (corners.max(axis=0) - corners.min(axis=0) + (0.7, 0.7 + BELOW)).tolist()
    return float(np.clip(WIDTH * height / width, 2.0, 8.0)) * panels + 0.35
