"""The robots and sites of a study: what they say of themselves, as the rows of Table 1."""

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from experiments.dataset.records import RobotRecord
from experiments.definition.schema import StudyDefinition
from robots.api import floorplan
from robots.api.floorplan import FloorPlan
from robots.api.messages import Point
from robots.models import FloorPlan as PlanRow
from robots.models import Robot as Row

YES, NO, UNKNOWN = "yes", "no", "–"


def robots_of(study: StudyDefinition, driven: Iterable[str]) -> tuple[RobotRecord, ...]:
    """Return the robots that were driven, by name, and those at the study's sites that could have
    been.
    """
    wanted, names = {(one.robot, one.site) for one in study.conditions}, set(driven)
    rows = Row.objects.select_related("floor_plan").order_by("name")
    found = [
        row
        for row in rows
        if row.name in names
        or (series_of(row), row.floor_plan.name if row.floor_plan else "") in wanted
    ]
    return tuple(
        RobotRecord(
            name=row.name,
            title=row.title,
            series=series_of(row),
            facts=facts(row.presence.factsheet or {}, study),
        )
        for row in found
    )


def series_of(row: Row) -> str:
    """Return what courses call a robot; its own name when it was never heard of."""
    found: str = (row.presence.factsheet or {}).get("series", row.name)
    return found


def facts(sheet: Mapping[str, Any], study: StudyDefinition) -> dict[str, str]:
    """Return what a factsheet and the study say of a robot, row by row of Table 1."""
    series, can = sheet.get("series", ""), sheet.get("capabilities", ())
    courses = [course for course in study.courses if course.robot == series]
    entries = {condition.access for condition in study.conditions if condition.robot == series}
    return {
        "Base": series or UNKNOWN,
        "Robot control architecture": sheet.get("rca") or UNKNOWN,
        "Size (m)": _size(sheet.get("footprint")),
        "Greatest speed (m/s)": _limit(sheet, "linear"),
        "Greatest turn rate (rad/s)": _limit(sheet, "angular"),
        "Camera": _camera(sheet.get("camera")),
        "Tilting head": YES if sheet.get("tilt") else NO,
        "Laser": YES if sheet.get("laser") or "scan" in can else NO,
        "Self-localization": YES if "localization" in can else NO,
        "Docks by itself": YES if "dock" in can else NO,
        "Mirror task": YES if any(course.photo for course in courses) else NO,
        "Agent": sheet.get("agent_version") or UNKNOWN,
        "Participants": ", ".join(
            sorted({"open": "everybody", "invitation": "by invitation"}[one] for one in entries)
        )
        or UNKNOWN,
    }


def _limit(sheet: Mapping[str, Any], name: str) -> str:
    value = sheet.get("limits", {}).get(name)
    return UNKNOWN if value is None else f"{value:g}"


def _size(footprint: Iterable[Point] | None) -> str:
    """Return length and width of what a robot covers of the floor; x is forward."""
    if footprint is None:
        return UNKNOWN
    x, y = zip(*footprint, strict=True)
    return f"{max(x) - min(x):.2f} × {max(y) - min(y):.2f}"


def _camera(camera: Mapping[str, Any] | None) -> str:
    return (
        UNKNOWN
        if camera is None
        else f"{camera['width']}×{camera['height']}, {camera['hfov'] * 57.29578:.0f}°"
    )


def plans_of(study: StudyDefinition) -> dict[str, FloorPlan]:
    sites = {one.site for one in (*study.conditions, *study.courses)}
    rows = (
        PlanRow.objects.filter(name__in=sorted(sites)).order_by("name").values_list("name", "plan")
    )
    return {name: floorplan.decode(msgspec.json.encode(plan)) for name, plan in rows if plan}
