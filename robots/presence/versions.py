"""What a robot's new factsheet changes in its software and its profile, for the log of
interventions.
"""

import datetime
import uuid
from typing import Any

from accounts import audit
from accounts.interventions import AGENT_CHANGED, PROFILE_CHANGED
from accounts.models import AuditEntry

SOFTWARE = ("agentVersion", "adapter", "driver")
# What decides how a robot stops: its profile states it, on the robot's computer.
PROFILE = ("series", "rca", "limits", "watchdog", "navigationControl", "footprint", "capabilities")
_NAMESPACE = uuid.UUID("c2c0a5f4-1b53-4a3e-9c6e-51f3b8f5f0a7")


def changes_of(
    robot: str, before: dict[str, Any] | None, after: dict[str, Any], now: datetime.datetime
) -> list[AuditEntry]:
    """Return an entry for changed software, and one for a changed profile; each has the values
    before and after. A robot's first factsheet changes everything.

    The keys follow from robot, run and values, so that a factsheet that is taken again after a
    failed write adds nothing.
    """
    entries = []
    for act, names in ((AGENT_CHANGED, SOFTWARE), (PROFILE_CHANGED, PROFILE)):
        old = {name: (before or {}).get(name) for name in names}
        new = {name: after.get(name) for name in names}
        data = {name: [old[name], new[name]] for name in names if old[name] != new[name]}
        if data:
            key = uuid.uuid5(_NAMESPACE, f"{robot} {after.get('boot')} {act} {sorted(data)}")
            entries.append(audit.entry(act, pk=key, at=now, robot=robot, role="robot", data=data))
    return entries
