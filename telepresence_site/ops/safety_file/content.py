"""What the file says about this installation, from its database and its software."""

import datetime
import platform
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

from django.conf import settings
from django.db import connection
from django.db.models import Count, Max, Min
from django.template import Context, Engine

from accounts.interventions import INTERVENTIONS, SAFETY_TEST
from accounts.models import AuditEntry
from robots.admin_pages.interventions import ACTS, described as described_entry
from robots.models import Robot
from sessions.safety_test.page import described as described_test
from telepresence_site.ops.safety_file.document import SafetyDocument, SafetyRow
from telepresence_site.ops.safety_file.test_results import TestResults

SHEET = ("series", "rca", "agentVersion", "adapter", "driver", "watchdog", "navigationControl")
CHANGES = ("limits_changed", "profile_changed", "agent_changed", "site_changed")


def rendered(document: SafetyDocument, results: TestResults, now: datetime.datetime) -> str:
    """Return the file as HTML that loads nothing. Its template is not a page of the site, so that
    it has its own style.
    """
    template = Engine(dirs=[Path(__file__).parent]).get_template("safety_file.html")
    return str(template.render(Context(_content(document, results, now))))


def _content(
    document: SafetyDocument, results: TestResults, now: datetime.datetime
) -> dict[str, Any]:
    tables = {
        name: [_covered(row, results) for row in getattr(document, name)]
        for name in ("hazards", "functions", "parts")
    }
    return tables | {
        "now": now,
        "version": settings.VERSION,
        "software": _software(),
        "libraries": _libraries(),
        "runs": results.runs,
        "robots": [_robot(robot) for robot in _robots()],
        "interventions": _interventions(),
        "changes": [
            described_entry(row) | {"robot": row.robot}
            for row in AuditEntry.objects.filter(act__in=CHANGES).order_by("-at")
        ],
        "kept_days": settings.RETENTION_DAYS["interventions"],
    }


def _covered(row: SafetyRow, results: TestResults) -> dict[str, Any]:
    tests = [{"name": test, "outcome": results.of(test)} for test in row.tests]
    return {"cells": row.cells, "tests": tests}


def _robots() -> list[Robot]:
    return list(Robot.objects.filter(practice=False).select_related("presence").order_by("name"))


def _robot(robot: Robot) -> dict[str, Any]:
    sheet = robot.presence.factsheet or {}
    tests = AuditEntry.objects.filter(act=SAFETY_TEST, robot=robot.name).order_by("-at")
    return {
        "name": robot.name,
        "title": robot.title,
        "facts": [(name, sheet[name]) for name in SHEET if sheet.get(name) not in {None, ""}],
        "limits": sorted(sheet.get("limits", {}).items()),
        "site_limits": [
            (name, value)
            for name, value in (
                ("max_linear", robot.max_linear),
                ("max_angular", robot.max_angular),
                ("assist", robot.assist),
            )
            if value is not None
        ],
        "tests": [described_test(row) for row in tests],
    }


def _software() -> list[tuple[str, str]]:
    return [
        ("site", settings.VERSION),
        ("Python", platform.python_version()),
        ("operating system", platform.platform()),
        ("database", connection.vendor),
    ]


def _libraries() -> list[tuple[str, str]]:
    found = {(each.name or "").lower(): each.version for each in distributions()}
    return sorted(found.items())


def _interventions() -> list[dict[str, Any]]:
    rows = (
        AuditEntry.objects.filter(act__in=INTERVENTIONS)
        .order_by()
        .values("robot", "act", "role")
        .annotate(number=Count("pk"), first=Min("at"), last=Max("at"))
    )
    ordered = sorted(rows, key=lambda row: (row["robot"], row["act"], row["role"]))
    return [row | {"what": ACTS.get(row["act"], row["act"])} for row in ordered]
