"""A study that is over in a minute: one checkpoint in the laboratory, from the station and back."""

import json

import msgspec
from django.utils import timezone

from experiments import publishing
from experiments.definition.schema import StudyDefinition
from experiments.definition.shipped import shipped
from tests.support.sessions.site import Site


def short_study(*, minutes: float = 5.0) -> StudyDefinition:
    """The paper's study with Giraff, all doors open, and a short course without a photo."""
    written = msgspec.to_builtins(shipped()["exploration"])
    course = next(one for one in written["courses"] if one["robot"] == "giraff")
    near = {**course["checkpoints"][1], "number": 1, "x": 2.0, "y": 4.6}
    course |= {"checkpoints": [course["checkpoints"][0], near]}
    course |= {"path": [], "doors": [], "zones": []}
    course.pop("photo", None)
    steps = [
        {**step, "minutes": minutes} if step["kind"] == "task" else step
        for step in written["steps"]
    ]
    conditions = [one for one in written["conditions"] if one["key"] == "giraff_open"]
    written |= {"slug": "short", "steps": steps, "conditions": conditions, "courses": [course]}
    written["analyses"] = []  # they compare conditions
    return msgspec.convert(written, StudyDefinition)


def as_json(study: StudyDefinition) -> str:
    """The study as Python code may hold it."""
    return json.dumps(msgspec.to_builtins(study))


def store_in(site: Site) -> None:
    """Put the study into a site's database, as a draft."""
    site.django(f"from {__name__} import store; store()")


def store() -> None:
    publishing.store(short_study(), timezone.now())


def bots_command(site: Site, *arguments: str, within: float = 420.0) -> str:
    """Run a command that lets bots play, which takes minutes, and return what it prints."""
    return site.run("manage.py", *arguments, within=within)
