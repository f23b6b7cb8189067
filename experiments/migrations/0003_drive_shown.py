"""What a drive shows and by which clock; draws of which no two are the same. Who is there already
gets a word each before it is unique.
"""

import uuid
from typing import Any

from django.db import migrations, models


def not_drawn() -> str:
    """Return a unique word for somebody who was not assigned yet."""
    return uuid.uuid4().hex


def give_words(apps: Any, _schema_editor: Any) -> None:
    """Give everybody a word of their own."""
    for participant in apps.get_model("experiments", "Participant").objects.only("pk").iterator():
        participant.drawn_as = not_drawn()
        participant.save(update_fields=["drawn_as"])


class Migration(migrations.Migration):

    dependencies = [
        ("experiments", "0002_personallink_kind"),
    ]

    operations = [
        migrations.AddField(
            model_name="drive",
            name="shown",
            field=models.JSONField(blank=True, default=dict, editable=False, verbose_name="shown"),
        ),
        migrations.AddField(
            model_name="drive",
            name="clock_offset",
            field=models.FloatField(editable=False, null=True, verbose_name="clock offset (s)"),
        ),
        migrations.AddField(
            model_name="participant",
            name="drawn_as",
            field=models.CharField(default=not_drawn, editable=False, max_length=100),
        ),
        migrations.RunPython(give_words, migrations.RunPython.noop),
        migrations.AlterField(
            model_name="participant",
            name="drawn_as",
            field=models.CharField(
                default=not_drawn, editable=False, max_length=100, unique=True
            ),
        ),
    ]
