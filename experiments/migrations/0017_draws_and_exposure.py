"""Each draw of a cell is a row, a drive knows when its participant first saw the robot's video, with
which software it was made, and a consent whether the data may be published.
"""

import uuid

import django.db.models.deletion
from django.db import migrations, models


class Migration(migrations.Migration):
    dependencies = [
        ("experiments", "0016_invitations_and_media"),
    ]

    operations = [
        migrations.AddField(
            model_name="consentreceipt",
            name="sharing",
            field=models.BooleanField(null=True, verbose_name="data may be shared"),
        ),
        migrations.AddField(
            model_name="consentreceipt",
            name="sharing_text",
            field=models.TextField(blank=True, verbose_name="text on sharing as shown"),
        ),
        migrations.RenameField("drive", "exposed", "moved"),
        migrations.AlterField(
            model_name="drive",
            name="moved",
            field=models.BooleanField(default=False, verbose_name="moved the robot"),
        ),
        migrations.AddField(
            model_name="drive",
            name="exposed_at",
            field=models.DateTimeField(blank=True, null=True, verbose_name="exposed"),
        ),
        migrations.AddField(
            model_name="drive",
            name="versions",
            field=models.JSONField(blank=True, default=dict, verbose_name="versions"),
        ),
        migrations.AddField(
            model_name="participant",
            name="draws_applied",
            field=models.PositiveIntegerField(default=0, verbose_name="draws"),
        ),
        migrations.AddField(
            model_name="participant",
            name="withdrawn_stage",
            field=models.CharField(blank=True, max_length=12, verbose_name="reached"),
        ),
        migrations.CreateModel(
            name="Draw",
            fields=[
                (
                    "id",
                    models.UUIDField(
                        default=uuid.uuid4, editable=False, primary_key=True, serialize=False
                    ),
                ),
                (
                    "kind",
                    models.CharField(
                        choices=[
                            ("participant", "participant"),
                            ("pilot", "pilot"),
                            ("bot", "bot"),
                        ],
                        max_length=12,
                        verbose_name="kind",
                    ),
                ),
                ("number", models.PositiveIntegerField(verbose_name="number")),
                ("nth", models.PositiveIntegerField(verbose_name="of the participant")),
                (
                    "reason",
                    models.CharField(
                        choices=[
                            ("first", "first assignment"),
                            ("again", "assigned again, because nothing had been seen of the first"),
                        ],
                        max_length=10,
                        verbose_name="reason",
                    ),
                ),
                ("cell", models.CharField(max_length=400, verbose_name="cell")),
                ("best", models.JSONField(default=list, verbose_name="best cells")),
                ("counts", models.JSONField(default=dict, verbose_name="places taken")),
                (
                    "scores",
                    models.JSONField(default=dict, verbose_name="places of alike participants"),
                ),
                (
                    "levels",
                    models.JSONField(blank=True, default=dict, verbose_name="balance factors"),
                ),
                (
                    "best_probability",
                    models.FloatField(default=1.0, verbose_name="probability of the best cell"),
                ),
                ("seed", models.BigIntegerField(null=True, verbose_name="randomisation seed")),
                ("at", models.DateTimeField(null=True, verbose_name="time")),
                (
                    "participant",
                    models.ForeignKey(
                        on_delete=django.db.models.deletion.CASCADE,
                        related_name="draws",
                        to="experiments.participant",
                        verbose_name="participant",
                    ),
                ),
                (
                    "study",
                    models.ForeignKey(
                        on_delete=django.db.models.deletion.PROTECT,
                        related_name="draws",
                        to="experiments.study",
                        verbose_name="study",
                    ),
                ),
            ],
            options={
                "verbose_name": "draw",
                "verbose_name_plural": "draws",
                "ordering": ("number",),
                "constraints": [
                    models.UniqueConstraint(
                        fields=("study", "kind", "number"), name="draw_number_once"
                    ),
                    models.UniqueConstraint(
                        fields=("participant", "nth"), name="nth_draw_once"
                    ),
                ],
            },
        ),
    ]
