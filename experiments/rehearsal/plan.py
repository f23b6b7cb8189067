"""Which bots a rehearsal needs, whether bots can play the study, and about how long it takes."""

import math

from django.utils.translation import gettext_lazy as _

from experiments.bots.endings import Ending
from experiments.definition.schema import StudyDefinition
from experiments.rehearsal.report import DRIVER, SLOWEST
from robots.world.robot_models import MODELS

EACH = 2  # bots that go through each condition to the end
AT_ONCE = 2  # bots that take part at a time
SPEED = 10.0  # times real time, at most
SEED = 1
ASIDE = (Ending.SKIPS_PHOTO, Ending.REFUSES, Ending.LEAVES_AT_DOCK, Ending.COMES_AGAIN)
# Seconds of processor time for each second of a drive (docs/howto/rehearse.md).
PROCESSOR_SECONDS = 0.75
START_MINUTES = 1.0  # until a sandbox runs, and to evaluate what was played
WITH_OPERATOR = _(
    "The study has a hidden operator, whose page drives by WebRTC: bots cannot rehearse it. "
    "docs/howto/rehearse.md describes how to rehearse it with a person who operates."
)
WITHOUT_SIMULATION = _(
    "There is no simulation of %(name)s: bots can rehearse only with %(robots)s."
)


def endings(study: StudyDefinition, each: int = EACH) -> list[Ending]:
    """Return the ending of each bot: `each` bots complete each condition, a few end otherwise."""
    through = max(2, each) * max(1, len(study.conditions))
    return [Ending.COMPLETES] * through + list(ASIDE)


def problems(study: StudyDefinition) -> list[str]:
    """Return why bots cannot play a study, in sentences: it needs robots without a simulation, or a
    person who operates them.
    """
    series = sorted({condition.robot for condition in study.conditions} - set(MODELS))
    # An operator's page drives by WebRTC alone, and bots have none.
    operated = [] if study.wizard is None else [str(WITH_OPERATOR)]
    robots = ", ".join(sorted(MODELS))
    return operated + [WITHOUT_SIMULATION % {"name": name, "robots": robots} for name in series]


def expected_minutes(study: StudyDefinition, cores: int) -> int:
    """Return about how long it takes on an idle computer, rounded up. A limit usually leaves people
    a multiple of their time, and people need a multiple of a bot's. Two bots drive at a time where
    there are two robots, and time goes as fast as the processor can follow.
    """
    limit = study.task.minutes if study.task is not None else 0.0
    robots = {(condition.robot, condition.site) for condition in study.conditions}
    drives = len(endings(study)) * limit / (SLOWEST * DRIVER)
    together = max(1, min(AT_ONCE, len(robots)))
    pace = min(SPEED, cores / PROCESSOR_SECONDS)
    return math.ceil(START_MINUTES + drives / together / pace)
