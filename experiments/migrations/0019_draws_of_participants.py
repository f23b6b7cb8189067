"""A participant's row no longer repeats what their last draw says."""

import uuid
from typing import Any

from django.db import migrations, models


def give_words(apps: Any, _schema_editor: Any) -> None:
    """On the way back: give everybody a word of their own, before it is unique again."""
    for participant in apps.get_model("experiments", "Participant").objects.only("pk").iterator():
        participant.drawn_as = uuid.uuid4().hex
        participant.save(update_fields=["drawn_as"])


class Migration(migrations.Migration):
    dependencies = [
        ("experiments", "0018_frozen_values"),
    ]

    operations = [
        migrations.AlterField(
            model_name="participant",
            name="drawn_as",
            field=models.CharField(default="", editable=False, max_length=100),
        ),
        migrations.RunPython(migrations.RunPython.noop, give_words),
        *(
            migrations.RemoveField("participant", name)
            for name in ("assigned_at", "candidates", "draw_seed", "drawn_as")
        ),
    ]
