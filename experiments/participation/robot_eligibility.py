"""Whether a study may use a robot that has an owner.

A definition names only a series and a site, so anyone could write one for someone else's robot.
A study may therefore use a robot (for its invitations, exclusively, and for its researchers) only
while one of its publishers may operate the robot. Robots without an owner are for all studies.
"""

from accounts.models import User
from experiments.models import Study
from robots.access import manages_all_robots
from robots.models import Robot, RobotPermit


def may_use(slug: str, robot: Robot) -> bool:
    """Tell whether a study, in any published version, may use a robot."""
    if robot.owner_id is None:
        return True
    users = User.objects.filter(published_studies__slug=slug, is_active=True)
    found = users.exclude(published_studies__status=Study.Status.DRAFT).distinct()
    publishers = [user for user in found if not user.is_guest]
    operators = robot.permits.filter(kind=RobotPermit.Privilege.OPERATOR, user__in=publishers)
    return (
        any(user.pk == robot.owner_id for user in publishers)
        or operators.exists()
        or any(manages_all_robots(user) for user in publishers)
    )


def may_see(slug: str, robot: Robot) -> bool:
    """Tell whether a study's researchers may see where a robot is and its state."""
    is_open = robot.shown_to_visitors and robot.access == Robot.Access.OPEN
    return (robot.enabled and is_open) or may_use(slug, robot)
