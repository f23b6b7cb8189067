"""Rows of robots, with their presence and their credentials."""

import datetime
from typing import Any

from django.utils import timezone

from robots.models import FloorPlan, Robot, RobotCredentials, RobotPresence

PARTS = (RobotPresence, RobotCredentials)


def unsaved_robot(**fields: Any) -> Robot:
    """Return a robot that is not stored, with the rows that belong to it."""
    values = _by_table(fields)
    robot = Robot(**values.pop(Robot))
    for part, own in values.items():
        part(robot=robot, **own)
    return robot


def create_robots(*robots: Robot) -> None:
    """Store robots of `unsaved_robot`, with one statement per table."""
    Robot.objects.bulk_create(robots)
    RobotPresence.objects.bulk_create(robot.presence for robot in robots)
    RobotCredentials.objects.bulk_create(robot.credentials for robot in robots)


def create_robot(name: str = "giraff", **fields: Any) -> Robot:
    """Store a robot; fields of its presence and its credentials go into rows of their own."""
    robot = unsaved_robot(**{"name": name, "title": name.title()} | fields)
    create_robots(robot)
    return robot


def online_robot(name: str = "giraff", **fields: Any) -> Robot:
    """Store a robot that is online for longer than any test takes."""
    seen = timezone.now() + datetime.timedelta(hours=1)
    return create_robot(name, **{"connection": "ONLINE", "last_seen_at": seen} | fields)


def floor_plan(name: str, **fields: Any) -> FloorPlan:
    """Store a floor plan of one pixel."""
    size = {"resolution": 0.05, "origin_x": 0.0, "origin_y": 0.0, "width": 1, "height": 1}
    values = {"title": name.title(), "image": b"png", **size, **fields}
    return FloorPlan.objects.create(name=name, **values)


def robot_form(**fields: str) -> dict[str, str]:
    """Return what the form of a robot in the administration sends; it has no permits."""
    values = {"title": "Lab robot", "enabled": "on", "access": "open", "assist": "off"}
    values |= {"charge_limit": "20", "calls": "accept"}
    return values | {"permits-TOTAL_FORMS": "0", "permits-INITIAL_FORMS": "0"} | fields


def update_robots(**fields: Any) -> None:
    """Change fields of all robots, in their tables."""
    for model, values in _by_table(fields).items():
        if values:
            model.objects.update(**values)


def _by_table(fields: dict[str, Any]) -> dict[Any, dict[str, Any]]:
    found: dict[Any, dict[str, Any]] = {Robot: dict(fields)}
    for part in PARTS:
        columns = {field.name for field in part._meta.fields} & fields.keys()
        found[part] = {name: found[Robot].pop(name) for name in columns}
    return found
