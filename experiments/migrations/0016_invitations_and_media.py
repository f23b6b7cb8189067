"""Invitations of researchers, and pictures and videos of their own in instructions."""

import uuid

import django.db.models.deletion
from django.conf import settings
from django.db import migrations, models

ROLES = [
    ("owner", "owner: full access"),
    ("researcher", "researcher: sees data, excludes drives, intervenes"),
    ("viewer", "viewer: sees pseudonymous data"),
    ("wizard", "hidden operator: only operates the robot"),
    ("coder", "coder: codes replays, sees nothing else"),
]


class Migration(migrations.Migration):
    dependencies = [
        ("experiments", "0015_recruitment"),
        migrations.swappable_dependency(settings.AUTH_USER_MODEL),
    ]

    operations = [
        migrations.CreateModel(
            name="ResearcherInvitation",
            fields=[
                (
                    "id",
                    models.UUIDField(
                        default=uuid.uuid4, editable=False, primary_key=True, serialize=False
                    ),
                ),
                ("slug", models.SlugField(max_length=40, verbose_name="study")),
                ("email", models.EmailField(max_length=254, verbose_name="e-mail address")),
                ("role", models.CharField(choices=ROLES, max_length=12, verbose_name="role")),
                ("token_sha256", models.CharField(editable=False, max_length=64, unique=True)),
                ("created_at", models.DateTimeField(verbose_name="created")),
                ("expires_at", models.DateTimeField(verbose_name="expires")),
                (
                    "accepted_at",
                    models.DateTimeField(blank=True, null=True, verbose_name="accepted"),
                ),
                (
                    "invited_by",
                    models.ForeignKey(
                        on_delete=django.db.models.deletion.CASCADE,
                        related_name="+",
                        to=settings.AUTH_USER_MODEL,
                        verbose_name="invited by",
                    ),
                ),
            ],
            options={
                "verbose_name": "invitation",
                "verbose_name_plural": "invitations",
                "ordering": ("-created_at",),
            },
        ),
        migrations.CreateModel(
            name="InstructionMedia",
            fields=[
                ("name", models.CharField(max_length=64, primary_key=True, serialize=False)),
                ("slug", models.SlugField(max_length=40, verbose_name="study")),
                ("title", models.CharField(max_length=200, verbose_name="file name")),
                ("content", models.BinaryField()),
                ("uploaded_at", models.DateTimeField(verbose_name="uploaded")),
            ],
            options={
                "verbose_name": "picture of the instructions",
                "verbose_name_plural": "pictures of the instructions",
            },
        ),
    ]
