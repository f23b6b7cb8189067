"""Which user may operate which session of a study: the provider of sessions/wizard/operators.py."""

from django.utils.translation import get_language

from accounts.models import User
from experiments.access import OPERATING, may_operate_as_wizard, role_of
from experiments.definition.schema import StudyDefinition
from experiments.models import Drive, Participant, Study, StudyMember
from experiments.participation.drive_status import robots_of
from experiments.participation.robot_eligibility import may_see
from experiments.wizard.script import script_of
from robots.models import Robot
from sessions.models import Session
from sessions.wizard.operators import OperatedSession
from surveys.documents import spoken


class StudyOperators:
    def may_operate(self, user: User, robot: Robot) -> bool:
        return any(robot in operated_robots(study.as_definition()) for study in _studies_of(user))

    def operated(self, user: User, session: Session) -> OperatedSession | None:
        drive = (
            Drive.objects.filter(session=session, participant__status=Participant.Status.ACTIVE)
            .select_related("participant__study")
            .first()
        )
        if drive is None or not may_operate_as_wizard(user, drive.participant.study.slug):
            return None
        definition = drive.participant.study.as_definition()
        wizard = definition.wizard_of(drive.condition)
        if wizard is None:
            return None
        language = get_language() or definition.languages[0]
        condition = definition.condition(drive.condition)
        title = spoken(condition.title, language) if condition is not None else ""
        return OperatedSession(
            participant=drive.participant.code,
            condition="" if wizard.blind else title,
            # other roles can look up the condition on other pages
            is_blind=wizard.blind and role_of(user, definition.slug) == "wizard",
            script=script_of(wizard, shown_in=language, spoken_in=drive.participant.language),
        )


def _studies_of(user: User) -> list[Study]:
    """Return the versions with a hidden operator of the studies that a user may operate."""
    rows = Study.objects.all()
    if not user.is_superuser:
        members = StudyMember.objects.filter(user=user, role__in=OPERATING)
        rows = rows.filter(slug__in=list(members.values_list("slug", flat=True)))
    return [study for study in rows if study.as_definition().wizard is not None]


def operated_robots(definition: StudyDefinition) -> list[Robot]:
    operated = tuple(one for one in definition.conditions if definition.wizard_of(one.key))
    robots = (robot for robot in robots_of(operated) if may_see(definition.slug, robot))
    return sorted(robots, key=lambda robot: robot.title)
