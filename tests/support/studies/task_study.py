"""A study of one short task, published in a running site: out of the station, one checkpoint behind
it with a photo, and home again.

`python -m tests.support.studies.task_study NAME MINUTES` makes it and puts the visitor NAME on its
task; so a test does it in the site's database.
"""

import json
import sys
from typing import Any

import django
import msgspec

from tests.support.sessions.site import Site


def definition_of(minutes: float) -> dict[str, Any]:
    """The shipped study's first condition, with a course of a few steps and no questions."""
    from experiments.definition import schema
    from experiments.definition.shipped import shipped

    document: dict[str, Any] = json.loads(schema.to_json(shipped()["exploration"]))
    steps = [
        step | ({"minutes": minutes} if step["kind"] == "task" else {})
        for step in document["steps"]
        if step["kind"] in {"task", "debrief"}
    ]
    course = next(one for one in document["courses"] if one["robot"] == "giraff")
    behind = {"number": 1, "x": 1.4, "y": 6.2, "radius": 0.6, "title": {"en": "Behind the station"}}
    short = course | {
        "checkpoints": [course["checkpoints"][0], behind],
        "photo": course["photo"] | {"checkpoint": 1},
        "path": [],
        "doors": [],
    }
    condition = next(one for one in document["conditions"] if one["key"] == "giraff_open")
    return document | {
        "slug": "short",
        "title": {"en": "Short"},
        "languages": ["en"],
        "steps": steps,
        "conditions": [condition],
        "courses": [short],
    }


def begin_short_study(site: Site, name: str, *, minutes: float = 5.0) -> None:
    """Publish it, and put a visitor on its task."""
    site.run("-m", "tests.support.studies.task_study", name, str(minutes))


def main(name: str, minutes: float) -> None:
    """Make the study and its participant in the database of the settings."""
    django.setup()
    from django.utils import timezone

    from accounts.models import User
    from experiments.definition import schema
    from experiments.models import Study
    from experiments.participation import progress

    now, document = timezone.now(), definition_of(minutes)
    sha256 = schema.digest(msgspec.convert(document, schema.StudyDefinition))
    row = Study.objects.create(
        slug="short",
        version=1,
        title="Short",
        definition=document,
        sha256=sha256,
        status="published",
        created_at=now,
        published_at=now,
    )
    user, _ = User.objects.get_or_create(username=name)
    progress.enter(row, user, access="open", recruitment={}, now=now)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
