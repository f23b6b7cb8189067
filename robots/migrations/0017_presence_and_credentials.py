"""What other processes write of a robot gets rows of its own."""

from functools import partial

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


unset = {"editable": False, "null": True}
text = partial(models.CharField, blank=True, editable=False)
moment = partial(models.DateTimeField, **unset)
TURNAROUND = [
    ("ready", "ready"),
    ("returning", "returning home"),
    ("charging", "charging"),
    ("paused", "paused"),
]


def of_robot(name):
    is_key = {"editable": False, "primary_key": True, "serialize": False}
    return "robot", models.OneToOneField(
        "robots.robot", models.CASCADE, related_name=name, **is_key
    )


class Migration(migrations.Migration):
    dependencies = [("robots", "0016_experienced_help_text")]
    operations = [
        migrations.CreateModel(
            name="RobotCredentials",
            fields=[
                of_robot("credentials"),
                ("screen_hash", text(max_length=200)),
                ("screen_made_at", moment("screen key created")),
                ("credential_hash", text(max_length=200)),
                ("bcrypt_hash", text(max_length=100)),
                ("credential_made_at", moment("credentials created")),
                ("credential_user", text(max_length=80)),
                ("former_user", text(max_length=80)),
                ("former_hash", text(max_length=200)),
                ("former_bcrypt_hash", text(max_length=100)),
                ("former_until", moment()),
                ("renewal_asked_at", moment("credential renewal requested")),
            ],
            options=dict.fromkeys(("verbose_name", "verbose_name_plural"), "robot credentials"),
        ),
        migrations.CreateModel(
            name="RobotPresence",
            fields=[
                of_robot("presence"),
                (
                    "connection",
                    models.CharField("connection", max_length=20, default="OFFLINE", editable=False),
                ),
                ("boot", text(max_length=64)),
                ("last_seen_at", moment("last seen")),
                ("factsheet", models.JSONField("factsheet", blank=True, **unset)),
                ("report", models.JSONField("last state", blank=True, **unset)),
                (
                    "turnaround",
                    models.CharField(
                        "between visits",
                        max_length=10,
                        choices=TURNAROUND,
                        default="ready",
                        editable=False,
                    ),
                ),
                ("turnaround_reason", text("reason", max_length=300)),
                ("turnaround_at", moment("since")),
            ],
            options=dict.fromkeys(("verbose_name", "verbose_name_plural"), "robot presence"),
        ),
        migrations.RunPython(split, join),
    ]
