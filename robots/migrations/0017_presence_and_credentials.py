"""What other processes write of a robot gets rows of its own."""

import django.db.models.deletion
from django.db import migrations, models


PRESENCE = (
    "connection boot last_seen_at factsheet report turnaround turnaround_reason turnaround_at"
).split()
CREDENTIALS = (
    "screen_hash screen_made_at credential_hash bcrypt_hash credential_made_at credential_user"
    " former_user former_hash former_bcrypt_hash former_until renewal_asked_at"
).split()
PARTS = (("RobotPresence", PRESENCE), ("RobotCredentials", CREDENTIALS))


def split(apps, _editor):
    robots = apps.get_model("robots", "Robot").objects
    for model, names in PARTS:
        part = apps.get_model("robots", model)
        part.objects.bulk_create(
            [
                part(robot_id=key, **dict(zip(names, values, strict=True)))
                for key, *values in robots.values_list("pk", *names)
            ],
            batch_size=500,
        )


def join(apps, _editor):
    robots = apps.get_model("robots", "Robot").objects
    for model, names in PARTS:
        for row in apps.get_model("robots", model).objects.values("robot", *names):
            robots.filter(pk=row.pop("robot")).update(**row)


class Migration(migrations.Migration):
    dependencies = [
        ("robots", "0016_experienced_help_text"),
    ]

    operations = [
        migrations.CreateModel(
            name="RobotCredentials",
            fields=[
                (
                    "robot",
                    models.OneToOneField(
                        editable=False,
                        on_delete=django.db.models.deletion.CASCADE,
                        primary_key=True,
                        related_name="credentials",
                        serialize=False,
                        to="robots.robot",
                    ),
                ),
                ("screen_hash", models.CharField(blank=True, editable=False, max_length=200)),
                (
                    "screen_made_at",
                    models.DateTimeField(
                        editable=False, null=True, verbose_name="screen key created"
                    ),
                ),
                ("credential_hash", models.CharField(blank=True, editable=False, max_length=200)),
                ("bcrypt_hash", models.CharField(blank=True, editable=False, max_length=100)),
                (
                    "credential_made_at",
                    models.DateTimeField(
                        editable=False, null=True, verbose_name="credentials created"
                    ),
                ),
                ("credential_user", models.CharField(blank=True, editable=False, max_length=80)),
                ("former_user", models.CharField(blank=True, editable=False, max_length=80)),
                ("former_hash", models.CharField(blank=True, editable=False, max_length=200)),
                (
                    "former_bcrypt_hash",
                    models.CharField(blank=True, editable=False, max_length=100),
                ),
                ("former_until", models.DateTimeField(editable=False, null=True)),
                (
                    "renewal_asked_at",
                    models.DateTimeField(
                        editable=False, null=True, verbose_name="credential renewal requested"
                    ),
                ),
            ],
            options={
                "verbose_name": "robot credentials",
                "verbose_name_plural": "robot credentials",
            },
        ),
        migrations.CreateModel(
            name="RobotPresence",
            fields=[
                (
                    "robot",
                    models.OneToOneField(
                        editable=False,
                        on_delete=django.db.models.deletion.CASCADE,
                        primary_key=True,
                        related_name="presence",
                        serialize=False,
                        to="robots.robot",
                    ),
                ),
                (
                    "connection",
                    models.CharField(
                        default="OFFLINE", editable=False, max_length=20, verbose_name="connection"
                    ),
                ),
                ("boot", models.CharField(blank=True, editable=False, max_length=64)),
                (
                    "last_seen_at",
                    models.DateTimeField(editable=False, null=True, verbose_name="last seen"),
                ),
                (
                    "factsheet",
                    models.JSONField(
                        blank=True, editable=False, null=True, verbose_name="factsheet"
                    ),
                ),
                (
                    "report",
                    models.JSONField(
                        blank=True, editable=False, null=True, verbose_name="last state"
                    ),
                ),
                (
                    "turnaround",
                    models.CharField(
                        choices=[
                            ("ready", "ready"),
                            ("returning", "returning home"),
                            ("charging", "charging"),
                            ("paused", "paused"),
                        ],
                        default="ready",
                        editable=False,
                        max_length=10,
                        verbose_name="between visits",
                    ),
                ),
                (
                    "turnaround_reason",
                    models.CharField(
                        blank=True, editable=False, max_length=300, verbose_name="reason"
                    ),
                ),
                (
                    "turnaround_at",
                    models.DateTimeField(editable=False, null=True, verbose_name="since"),
                ),
            ],
            options={
                "verbose_name": "robot presence",
                "verbose_name_plural": "robot presence",
            },
        ),
        migrations.RunPython(split, join),
    ]
