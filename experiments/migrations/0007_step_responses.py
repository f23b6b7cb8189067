"""Where in a study a response was asked stands in columns. Until now it was read from the context
of the response, which stays as it is: taken back, this loses nothing.
"""

import re
import uuid
from itertools import islice
from typing import Any

import django.db.models.deletion
from django.db import migrations, models

CONTEXT = re.compile(r"study/([0-9a-f-]{36})/(\d+)\.(\d+)\.([a-z0-9_-]+)")
AT_ONCE = 500


def read_contexts(apps: Any, _schema_editor: Any) -> None:
    """Read the place of every response that was asked in a study."""
    place = apps.get_model("experiments", "StepResponse")
    people = {
        str(key): key
        for key in apps.get_model("experiments", "Participant").objects.values_list("pk", flat=True)
    }
    asked = apps.get_model("surveys", "Response").objects.filter(context__startswith="study/")
    contexts = list(asked.values_list("pk", "context"))
    rows = (
        place(
            response_id=response,
            participant_id=people[found[1]],
            visit=int(found[2]),
            round=int(found[3]),
            step=found[4],
        )
        for response, context in contexts
        if (found := CONTEXT.fullmatch(context)) and found[1] in people
    )
    while batch := list(islice(rows, AT_ONCE)):
        place.objects.bulk_create(batch)


class Migration(migrations.Migration):

    dependencies = [
        ("surveys", "0001_initial"),
        ("experiments", "0006_drive_ends"),
    ]

    operations = [
        migrations.CreateModel(
            name="StepResponse",
            fields=[
                (
                    "id",
                    models.UUIDField(
                        default=uuid.uuid4, editable=False, primary_key=True, serialize=False
                    ),
                ),
                ("visit", models.PositiveIntegerField(verbose_name="visit")),
                ("round", models.PositiveIntegerField(verbose_name="round")),
                ("step", models.CharField(max_length=40, verbose_name="step")),
                (
                    "participant",
                    models.ForeignKey(
                        on_delete=django.db.models.deletion.CASCADE,
                        related_name="responses",
                        to="experiments.participant",
                        verbose_name="participant",
                    ),
                ),
                (
                    "response",
                    models.OneToOneField(
                        on_delete=django.db.models.deletion.CASCADE,
                        related_name="asked_at",
                        to="surveys.response",
                        verbose_name="response",
                    ),
                ),
            ],
            options={
                "verbose_name": "response at a step",
                "verbose_name_plural": "responses at steps",
            },
        ),
        migrations.RunPython(read_contexts, migrations.RunPython.noop),
    ]
