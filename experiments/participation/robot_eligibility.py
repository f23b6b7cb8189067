"""Whether a robot that has an owner is at a study's disposal: because somebody who may operate it
has published the study.

A study says only with what kind of robot, and where, it is driven; anybody who builds one could
write that of anybody's robot. So its invitations open a robot, its participants have a robot to
themselves, and its researchers see and hold one, only as long as whoever published it may operate
the robot; who takes the permit away takes the robot back. Robots without an owner are the site's,
for all studies.
"""

from accounts.models import User
from experiments.models import Study
from robots.access import oversees
from robots.models import Robot, RobotPermit


def is_lent(robot: Robot, slug: str) -> bool:
    """Tell whether a study, in any version that was published, has a robot at its disposal."""
    if robot.owner_id is None:
        return True
    found = (
        User.objects.filter(published_studies__slug=slug)
        .exclude(published_studies__status=Study.Status.DRAFT)
        .filter(is_active=True)
        .distinct()
    )
    publishers = [user for user in found if not user.is_guest]
    operators = robot.permits.filter(kind=RobotPermit.Privilege.OPERATOR, user__in=publishers)
    return any(user.pk == robot.owner_id for user in publishers) or (
        operators.exists() or any(oversees(user) for user in publishers)
    )


def is_shown(robot: Robot, slug: str) -> bool:
    """Tell whether a study's researchers may see where a robot is and how it does: also that of a
    robot which is open to everybody.
    """
    is_open = robot.shown_to_visitors and robot.access == Robot.Access.OPEN
    return (robot.enabled and is_open) or is_lent(robot, slug)
