"""The robots of a study with their rows of Table 1, and the floor plans of its sites."""

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from experiments.dataset.records import RobotRecord
from experiments.definition.schema import StudyDefinition
from robots.api import floorplan
from robots.api.floorplan import FloorPlan
from robots.api.messages import Point
from robots.models import FloorPlan as PlanRow, Robot as Row

YES, NO, UNKNOWN = "yes", "no", "–"
ACCESS = {"open": "everybody", "invitation": "by invitation"}


def robots_of(study: StudyDefinition, driven: Iterable[str]) -> tuple[RobotRecord, ...]:
    """Return, by name, the driven robots and others of their series at the study's sites."""
    wanted, names = {(one.robot, one.site) for one in study.conditions}, set(driven)
    found = []
    for row in Row.objects.select_related("floor_plan").order_by("name"):
        sheet = row.presence.factsheet or {}
        series = sheet.get("series", row.name)  # of a robot that never connected, its own name
        site = row.floor_plan.name if row.floor_plan else ""
        if row.name in names or (series, site) in wanted:
            about = {"name": row.name, "title": row.title, "series": series}
            found.append(RobotRecord(**about, facts=facts(sheet, study)))
    return tuple(found)


def facts(sheet: Mapping[str, Any], study: StudyDefinition) -> dict[str, str]:
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
        "Participants": ", ".join(sorted(ACCESS[one] for one in entries)) or UNKNOWN,
    }


def _limit(sheet: Mapping[str, Any], name: str) -> str:
    value = sheet.get("limits", {}).get(name)
    return UNKNOWN if value is None else f"{value:g}"


def _size(footprint: Iterable[Point] | None) -> str:
    """Return the length and width of a robot's footprint; x is forward."""
    if footprint is None:
        return UNKNOWN
    x, y = zip(*footprint, strict=True)
    return f"{max(x) - min(x):.2f} × {max(y) - min(y):.2f}"


def _camera(camera: Mapping[str, Any] | None) -> str:
    if camera is None:
        return UNKNOWN
    return f"{camera['width']}×{camera['height']}, {camera['hfov'] * 57.29578:.0f}°"


def plans_of(study: StudyDefinition) -> dict[str, FloorPlan]:
    sites = {one.site for one in (*study.conditions, *study.courses)}
    rows = PlanRow.objects.filter(name__in=sorted(sites)).order_by("name")
    return {row.name: floorplan.decode(msgspec.json.encode(row.plan)) for row in rows if row.plan}
