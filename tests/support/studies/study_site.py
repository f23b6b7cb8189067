"""The small study's site and robot in the database, as publishing finds them."""

import datetime

import msgspec
from django.utils import timezone

from robots.models import FloorPlan, Robot
from tests.support.agents.docked_robot import report_in_dock
from tests.support.robots import create_robot, floor_plan
from tests.support.studies.studies import PLAN

ALL = ("velocity", "goto", "follow", "dock", "undock", "tilt", "assist", "photo", "video", "doors")


def cabin_with_giraff() -> FloorPlan:
    """Return the cabin, with a giraff in it that has said what it is."""
    plan = floor_plan("cabin", width=160, height=80, plan=PLAN, sha256="0" * 64)
    robot_at(plan, "giraff", "giraff")
    return plan


def robot_at(
    plan: FloorPlan, name: str, series: str, *, capabilities=ALL, linear: float = 0.6
) -> Robot:
    """Make a robot whose factsheet has what studies ask of it."""
    sheet = {"series": series, "capabilities": list(capabilities), "limits": {"linear": linear}}
    seen = timezone.now() + datetime.timedelta(hours=1)  # for longer than any test takes
    return create_robot(
        name,
        floor_plan=plan,
        factsheet=msgspec.to_builtins(sheet),
        report=report_in_dock(plan, series),
        last_seen_at=seen,
    )
