"""A study of one short task, published in a running site: out of the station, one checkpoint behind
it with a photo, and home again; by the participant, or by a hidden operator.
"""

from typing import Any

import msgspec

from accounts.models import User
from experiments.definition import schema
from experiments.definition.shipped import shipped
from experiments.models import StudyMember
from tests.support.sessions.site import Site
from tests.support.studies import participants
from tests.support.studies.wizard_study import OPERATOR_TEXT, WIZARD

HIDDEN = "hidden"  # the study with an operator


def definition_of(minutes: float) -> dict[str, Any]:
    """The shipped study's first condition, with a course of a few steps and no questions."""
    document: dict[str, Any] = msgspec.to_builtins(shipped()["exploration"])
    steps = [
        step | ({"minutes": minutes} if step["kind"] == "task" else {})
        for step in document["steps"]
        if step["kind"] in {"task", "debrief"}
    ]
    course = next(one for one in document["courses"] if one["robot"] == "giraff")
    behind = {"number": 1, "x": 1.4, "y": 6.2, "radius": 0.6, "title": {"en": "Behind the station"}}
    course |= {"checkpoints": [course["checkpoints"][0], behind], "path": [], "doors": []}
    course["photo"] |= {"checkpoint": 1}
    conditions = [one for one in document["conditions"] if one["key"] == "giraff_open"]
    about = {"slug": "short", "title": {"en": "Short"}, "languages": ["en"]}
    return document | about | {"steps": steps, "conditions": conditions, "courses": [course]}


def begin_short_study(site: Site, name: str, *, minutes: float = 5.0) -> None:
    """Publish it in a site, and put a visitor on its task."""
    site.django(f"from {__name__} import publish; publish({name!r}, {minutes})")


def begin_wizard_study(site: Site, participant: str, operator: str) -> None:
    """Publish it in a site, with a participant on its task and an operator."""
    site.django(f"from {__name__} import publish; publish({participant!r}, 5.0, {operator!r})")


def publish(participant: str, minutes: float, operator: str = "") -> None:
    """Make the study and its people in the database of the settings."""
    document = definition_of(minutes)
    if operator:
        document |= {"slug": HIDDEN, "title": {"en": "Hidden"}, "wizard": WIZARD}
        document["steps"][-1]["operator"] = {"en": OPERATOR_TEXT}
        user, _ = User.objects.get_or_create(username=operator)
        StudyMember.objects.create(slug=HIDDEN, user=user, role=StudyMember.Role.WIZARD)
    study = participants.published(msgspec.convert(document, schema.StudyDefinition))
    participants.comer(study, User.objects.get_or_create(username=participant)[0])
