"""A rehearsal says how far it is. Those that were kept have ended, also when nobody noted it."""

import uuid
from typing import Any

import django.db.models.deletion
from django.conf import settings
from django.db import migrations, models

LOST = "Its process ended without a result."


def end_what_was_kept(apps: Any, _schema_editor: Any) -> None:
    """Give each its own key, and say of those without a report why there is none."""
    for row in apps.get_model("experiments", "Rehearsal").objects.all():
        has_report = "conditions" in row.report
        row.live_key, row.status = str(row.pk), "done" if has_report else "failed"
        row.reason = "" if has_report else " ".join(row.report.get("problems") or [LOST])
        row.finished_at = row.finished_at or row.began_at
        row.save(update_fields=["live_key", "status", "reason", "finished_at"])


class Migration(migrations.Migration):
    dependencies = [
        ("experiments", "0013_coded_events"),
        migrations.swappable_dependency(settings.AUTH_USER_MODEL),
    ]

    operations = [
        migrations.AddField(
            model_name="rehearsal",
            name="ended_by",
            field=models.ForeignKey(
                blank=True,
                null=True,
                on_delete=django.db.models.deletion.SET_NULL,
                related_name="+",
                to=settings.AUTH_USER_MODEL,
                verbose_name="ended by",
            ),
        ),
        migrations.AddField(
            model_name="rehearsal",
            name="host",
            field=models.CharField(blank=True, max_length=100, verbose_name="computer"),
        ),
        migrations.AddField(
            model_name="rehearsal",
            name="progress",
            field=models.JSONField(blank=True, default=dict, editable=False),
        ),
        migrations.AddField(
            model_name="rehearsal",
            name="reason",
            field=models.TextField(blank=True, verbose_name="reason"),
        ),
        migrations.AddField(
            model_name="rehearsal",
            name="seen_at",
            field=models.DateTimeField(blank=True, editable=False, null=True),
        ),
        migrations.AddField(
            model_name="rehearsal",
            name="status",
            field=models.CharField(
                choices=[
                    ("waiting", "waiting"),
                    ("running", "running"),
                    ("stopped", "ended by a researcher"),
                    ("failed", "did not finish"),
                    ("done", "finished"),
                ],
                default="waiting",
                max_length=10,
                verbose_name="status",
            ),
        ),
        migrations.AddField(
            model_name="rehearsal",
            name="live_key",
            field=models.CharField(default="", editable=False, max_length=40),
        ),
        migrations.RunPython(end_what_was_kept, migrations.RunPython.noop),
        migrations.AlterField(
            model_name="rehearsal",
            name="live_key",
            field=models.CharField(
                default=uuid.uuid4, editable=False, max_length=40, unique=True
            ),
        ),
    ]
