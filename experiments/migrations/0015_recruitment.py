"""Ids of recruitment sites become columns: one id is one participant of a study. Of those who came
with one id before, the first keeps it.
"""

import secrets
import uuid
from hashlib import sha256
from typing import Any

import django.db.models.deletion
from django.conf import settings
from django.db import migrations, models

import experiments.models

# Parameters that recruitment sites add to a link, as of this migration.
NAMES = ("PROLIFIC_PID", "workerId", "survey_code", "participantId")


def fill_in(apps: Any, _schema_editor: Any) -> None:
    """Give each participant their id, and a word of their own where there is none."""
    taken: set[str] = set()
    people = apps.get_model("experiments", "Participant").objects.select_related("study")
    for row in people.order_by("created_at"):
        given = (str(row.recruitment.get(name, "")).strip() for name in NAMES)
        row.recruitment_id = next((one for one in given if one and "%" not in one), "")[:100]
        word = f"{row.study.slug}:{sha256(row.recruitment_id.encode()).hexdigest()}"
        keeps = row.recruitment_id and row.kind == "participant" and word not in taken
        row.recruited_as = word if keeps else uuid.uuid4().hex
        taken.add(row.recruited_as)
        row.save(update_fields=["recruitment_id", "recruited_as"])


class Migration(migrations.Migration):
    dependencies = [
        ("experiments", "0014_rehearsal_state"),
        ("robots", "0001_squashed_0018_robot_without_presence"),
        migrations.swappable_dependency(settings.AUTH_USER_MODEL),
    ]

    operations = [
        migrations.AddField(
            "study",
            "code_key",
            models.CharField(blank=True, default="", editable=False, max_length=64),
            preserve_default=False,
        ),
        migrations.AddField(
            "participant",
            "recruitment_id",
            models.CharField(
                blank=True,
                db_index=True,
                default="",
                max_length=100,
                verbose_name="recruitment id",
            ),
            preserve_default=False,
        ),
        migrations.AddField(
            "participant",
            "recruited_as",
            models.CharField(default="", editable=False, max_length=120),
        ),
        migrations.RunPython(fill_in, migrations.RunPython.noop),
        migrations.AlterField(
            "participant",
            "recruited_as",
            models.CharField(
                default=experiments.models.not_drawn, editable=False, max_length=120, unique=True
            ),
        ),
        migrations.CreateModel(
            "StudyKey",
            fields=[
                (
                    "id",
                    models.UUIDField(
                        default=uuid.uuid4, editable=False, primary_key=True, serialize=False
                    ),
                ),
                ("slug", models.SlugField(max_length=40, verbose_name="study")),
                ("label", models.CharField(max_length=60, verbose_name="label")),
                ("token_sha256", models.CharField(editable=False, max_length=64, unique=True)),
                ("made_at", models.DateTimeField(verbose_name="created")),
                (
                    "last_used_at",
                    models.DateTimeField(editable=False, null=True, verbose_name="last used"),
                ),
                (
                    "made_by",
                    models.ForeignKey(
                        on_delete=django.db.models.deletion.CASCADE,
                        related_name="+",
                        to=settings.AUTH_USER_MODEL,
                        verbose_name="created by",
                    ),
                ),
            ],
            options={
                "verbose_name": "API key of a study",
                "verbose_name_plural": "API keys of studies",
                "constraints": [
                    models.UniqueConstraint(
                        fields=("slug", "label"), name="one_study_key_of_a_label"
                    )
                ],
            },
        ),
        migrations.CreateModel(
            "Contact",
            fields=[
                (
                    "id",
                    models.UUIDField(
                        default=uuid.uuid4, editable=False, primary_key=True, serialize=False
                    ),
                ),
                ("email", models.EmailField(max_length=254, verbose_name="e-mail address")),
                ("site", models.CharField(editable=False, max_length=200)),
                (
                    "token",
                    models.CharField(default=secrets.token_urlsafe, max_length=64, unique=True),
                ),
                ("given_at", models.DateTimeField(verbose_name="given")),
                (
                    "invite_at",
                    models.DateTimeField(
                        blank=True, null=True, verbose_name="invited to a second session"
                    ),
                ),
                (
                    "participant",
                    models.OneToOneField(
                        on_delete=django.db.models.deletion.CASCADE,
                        related_name="contact",
                        to="experiments.participant",
                        verbose_name="participant",
                    ),
                ),
            ],
            options={
                "verbose_name": "e-mail address of a participant",
                "verbose_name_plural": "e-mail addresses of participants",
            },
        ),
        migrations.CreateModel(
            "Appointment",
            fields=[
                (
                    "id",
                    models.UUIDField(
                        default=uuid.uuid4, editable=False, primary_key=True, serialize=False
                    ),
                ),
                ("visit", models.PositiveIntegerField(verbose_name="visit")),
                ("starts_at", models.DateTimeField(db_index=True, verbose_name="starts")),
                ("ends_at", models.DateTimeField(verbose_name="ends")),
                ("slot", models.CharField(editable=False, max_length=80, unique=True)),
                (
                    "reminded_at",
                    models.DateTimeField(blank=True, null=True, verbose_name="reminded"),
                ),
                (
                    "participant",
                    models.ForeignKey(
                        on_delete=django.db.models.deletion.CASCADE,
                        related_name="appointments",
                        to="experiments.participant",
                        verbose_name="participant",
                    ),
                ),
                (
                    "robot",
                    models.ForeignKey(
                        on_delete=django.db.models.deletion.CASCADE,
                        related_name="+",
                        to="robots.robot",
                        verbose_name="robot",
                    ),
                ),
            ],
            options={
                "verbose_name": "appointment",
                "verbose_name_plural": "appointments",
                "ordering": ("starts_at",),
            },
        ),
    ]
