"""The short task of tests/support/studies/task_study.py with a hidden operator, in a running site.

`python -m tests.support.studies.wizard_task PARTICIPANT OPERATOR` makes it, puts the participant on
its task and makes the operator one; so a test does it in the site's database.
"""

import sys

import django
import msgspec

from tests.support.sessions.site import Site
from tests.support.studies.task_study import definition_of
from tests.support.studies.wizard_study import OPERATOR_TEXT, WIZARD

SLUG = "hidden"


def begin_wizard_study(site: Site, participant: str, operator: str) -> None:
    """Publish it, with a participant on its task and an operator."""
    site.run("-m", "tests.support.studies.wizard_task", participant, operator)


def main(participant: str, operator: str) -> None:
    """Make the study and its people in the database of the settings."""
    django.setup()
    from django.utils import timezone

    from accounts.models import User
    from experiments.definition import schema
    from experiments.models import Study, StudyMember
    from experiments.participation import progress

    document = definition_of(5.0) | {"slug": SLUG, "title": {"en": "Hidden"}, "wizard": WIZARD}
    document["steps"][-1]["operator"] = {"en": OPERATOR_TEXT}
    definition = msgspec.convert(document, schema.StudyDefinition)
    now = timezone.now()
    row = Study.objects.create(
        slug=SLUG,
        version=1,
        title="Hidden",
        definition=document,
        sha256=schema.digest(definition),
        status="published",
        created_at=now,
        published_at=now,
    )
    user, _ = User.objects.get_or_create(username=participant)
    progress.enter(row, user, access="open", recruitment={}, now=now)
    user, _ = User.objects.get_or_create(username=operator)
    StudyMember.objects.create(slug=SLUG, user=user, role=StudyMember.Role.WIZARD)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
