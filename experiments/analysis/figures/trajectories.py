"""Figures 6 and 7 of the paper: the workspace with the suggested paths, and the trajectories."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from string import ascii_lowercase
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes

from experiments.analysis.figures import drawing, floor
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.tables.table import Table, amount, number, words
from experiments.dataset.columns import Floats
from experiments.dataset.records import Dataset
from experiments.definition.feasibility import dock_of
from experiments.definition.schema import Course

MOST_COLUMNS, TALLEST = 4, 8.0  # of panels, and inches
BARE = 0.45  # height of a panel without a plan, by its width
ABOVE_PANEL = 0.55  # inches: of its title
Paths = Mapping[str, Floats]  # by session
TITLE = 100  # characters of a line over the whole width


def figure_6(dataset: Dataset, site: str) -> drawing.Drawing:
    """Draw the workspace of a site with each course's checkpoints and suggested path."""
    courses = [course for course in dataset.study.courses if course.site == site]
    with drawing.house_style():
        figure, (axes,) = drawing.panels(1, 1, _height(dataset, site))
        if site in dataset.plans:
            floor.draw_plan(axes, dataset.plans[site])
        for index, course in enumerate(courses):
            _draw_course(axes, dataset, course, index)
        if courses:
            handles = axes.get_legend_handles_labels()
            figure.legend(*handles, loc="outside lower center", ncols=3, handlelength=3.0)
    stops = (
        (course.robot, site, "checkpoint", stop.number, number(stop.x), number(stop.y))
        for course in courses
        for stop in course.checkpoints
    )
    paths = (
        (course.robot, site, "path", index, number(x), number(y))
        for course in courses
        for index, (x, y) in enumerate(course.path)
    )
    title = "Schematic map of the robot workspace with the suggested paths and the charging points."
    head = ("robot", "site", "what", "number", "x", "y")
    return drawing.Drawing(figure, Table.of(f"figure-6-{site}", title, head, (*stops, *paths)))


def _draw_course(axes: Axes, dataset: Dataset, course: Course, index: int) -> None:
    place = index % len(drawing.ROBOTS)
    colour, dash = drawing.ROBOTS[place], drawing.DASHES[place]
    name = _robot_name(dataset, course.robot)
    stops = [(stop.x, stop.y) for stop in (*course.checkpoints, course.checkpoints[0])]
    xs, ys = np.array(course.path or stops).T
    look = drawing.Look(color=colour, linestyle=dash, linewidth=1.6, zorder=5)
    label, gid = f"suggested path of {name}", f"path-{course.robot}"
    axes.plot(xs, ys, **look, label=label, gid=gid)
    plan = dataset.plans.get(course.site)
    dock = dock_of(course, plan) if plan is not None else None
    if dock is not None:
        floor.draw_dock(axes, dock, name, colour)
    for stop in course.checkpoints:
        floor.draw_checkpoint(axes, stop, colour)


def _robot_name(dataset: Dataset, series: str) -> str:
    return next((one.title for one in dataset.robots if one.series == series), series)


def figure_7(dataset: Dataset, measured: Sequence[Measured]) -> drawing.Drawing:
    """Draw all trajectories, a panel a robot, site and condition, with one view for each site; one
    panel without trajectories if there are none.
    """
    ways = {one.session.id: floor.thinned(one.positions) for one in measured}
    found = _panels(dataset, measured)
    views = {
        site: floor.view_of(dataset.plans[site], _shown(dataset, found, ways, site))
        for site in {panel.site for panel in found} & set(dataset.plans)
    }
    behind: drawing.Behind = {}
    with drawing.house_style():
        columns, height = _layout([views.get(panel.site) for panel in found])
        figure, axes = drawing.panels(max(1, len(found)), columns, height)
        for empty in axes[len(found) :]:
            empty.set_axis_off()
        for panel, place in zip(found, axes, strict=False):
            behind |= _draw_panel(place, dataset, panel, ways, views.get(panel.site))
            place.set_title(_panel_title(dataset, panel, columns), loc="left", fontsize=7.5)
    rows = (
        (words(one.id, (one.id,)), one.robot, one.outcome, number(x, 3), number(y, 3))
        for one in (drive.session for drive in measured)
        for x, y in ways[one.id].tolist()
    )
    title, head = "Trajectories followed by the robots, by condition.", ("session", "robot")
    numbers = Table.of("figure-7", title, (*head, "outcome", "x", "y"), rows)
    return drawing.Drawing(figure, numbers, behind)


@dataclass(frozen=True)
class TrajectoryPanel:
    """The sessions of one condition on one course, and the label of their panel."""

    label: str
    site: str
    series: str
    condition: str
    own: tuple[Measured, ...]


def _panels(dataset: Dataset, measured: Sequence[Measured]) -> list[TrajectoryPanel]:
    """Return the panels in the order of courses and conditions; an empty one without sessions."""
    groups: dict[tuple[str, str, str], list[Measured]] = {}
    for one in measured:
        if len(one.positions):
            series = dataset.robot(one.session.robot).series
            key = (one.session.site, series, one.session.condition)
            groups.setdefault(key, []).append(one)
    courses = [(course.site, course.robot) for course in dataset.study.courses]
    known = [(*course, one.key) for course in courses for one in dataset.study.conditions]
    keys = [key for key in known if key in groups] + sorted(set(groups) - set(known))
    if not keys:
        return [TrajectoryPanel("a", *course, "", ()) for course in courses[:1]]
    return [
        TrajectoryPanel(label, *key, tuple(groups[key]))
        for label, key in zip(cycle(ascii_lowercase), keys, strict=False)
    ]


def _shown(
    dataset: Dataset, found: Sequence[TrajectoryPanel], ways: Paths, site: str
) -> list[Floats]:
    """Return the trajectories of a site's panels, and the checkpoints of courses in use."""
    here = [panel for panel in found if panel.site == site and panel.own]
    series = {panel.series for panel in here}
    courses = [one for one in dataset.study.courses if one.site == site and one.robot in series]
    stops = [np.array([(stop.x, stop.y)]) for one in courses for stop in one.checkpoints]
    return [*(ways[one.session.id] for panel in here for one in panel.own), *stops]


def _layout(views: Sequence[Floats | None]) -> tuple[int, float]:
    """Return the fewest columns that fit on a page with a panel for each view, and the inches of
    the height; a square of panels is made to fit.
    """
    sizes = [np.ptp(view, axis=0) for view in views if view is not None]
    ratio = max((float(size[1] / size[0]) + floor.BELOW for size in sizes), default=BARE)
    count = max(1, len(views))
    for columns in range(min(2, count), MOST_COLUMNS + 1):
        height = math.ceil(count / columns) * (drawing.WIDTH / columns * ratio + ABOVE_PANEL)
        if height <= TALLEST or count <= columns**2:
            break
    return columns, min(height, TALLEST)


def _panel_title(dataset: Dataset, panel: TrajectoryPanel, columns: int) -> str:
    """Return label, robot (unless the condition begins with it), condition, and amounts."""
    name = _robot_name(dataset, panel.series)
    titles = {one.key: dataset.say(one.title) for one in dataset.study.conditions}
    condition = titles.get(panel.condition, panel.condition)
    people = len({one.session.participant for one in panel.own})
    amounts = f"{amount(len(panel.own), 'session')} of {amount(people, 'participant')}"
    shown = condition if condition.startswith(name) else ": ".join(filter(None, (name, condition)))
    head = f"({panel.label}) {shown}"
    return f"{fill(head, TITLE // columns)}\n{amounts}"


def _draw_panel(
    axes: Axes, dataset: Dataset, panel: TrajectoryPanel, ways: Paths, view: Floats | None
) -> drawing.Behind:
    if view is not None:
        floor.draw_plan(axes, dataset.plans[panel.site], furniture=False, view=view)
    # many lines are faint, so that places where most went are dark
    alpha = float(np.clip(2.0 / max(1, len(panel.own)) ** 0.5, 0.15, 0.9))
    behind: drawing.Behind = {f"session-{one.session.id}": (one.session.id,) for one in panel.own}
    for gid, (session, *_) in behind.items():
        xs, ys = ways[session].T
        # dark enough for a faint thin line in a grey print
        look = drawing.Look(color=drawing.POSITIVE, linewidth=0.45, alpha=alpha, zorder=2.5)
        axes.plot(xs, ys, **look, gid=gid)
    where = (panel.site, panel.series)
    course = next((one for one in dataset.study.courses if (one.site, one.robot) == where), None)
    for stop in course.checkpoints if course else ():
        floor.draw_checkpoint(axes, stop, drawing.INK)
    return behind


def _height(dataset: Dataset, site: str) -> float:
    plan = dataset.plans.get(site)
    if plan is None:
        return 3.0
    width, height = np.ptp(floor.whole_of(plan), axis=0).tolist()
    return float(np.clip(drawing.WIDTH * (height / width + floor.BELOW), 2.0, 8.0)) + 0.35
