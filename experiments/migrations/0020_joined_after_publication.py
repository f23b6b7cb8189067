"""The row that stays after a withdrawal says no longer that its participant joined before the study
was published: its time was the beginning of the day of the withdrawal.
"""

from typing import Any

from django.db import migrations
from django.db.models import F


def correct(apps: Any, _schema_editor: Any) -> None:
    rows = apps.get_model("experiments", "Participant").objects.filter(status="withdrawn")
    wrong = rows.filter(kind="participant", created_at__lt=F("study__published_at"))
    for row in wrong.select_related("study"):
        row.created_at = row.study.published_at
        row.save(update_fields=["created_at"])


class Migration(migrations.Migration):
    dependencies = [
        ("experiments", "0019_draws_of_participants"),
    ]

    operations = [migrations.RunPython(correct, migrations.RunPython.noop)]
