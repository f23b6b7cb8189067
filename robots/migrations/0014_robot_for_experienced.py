"""Robots can be marked as those for experienced drivers."""

from django.db import migrations, models


class Migration(migrations.Migration):
    """No robot is marked until its owner does so."""

    dependencies = [
        ("robots", "0013_robotelsewhere"),
    ]

    operations = [
        migrations.AddField(
            model_name="robot",
            name="for_experienced",
            field=models.BooleanField(
                default=False,
                help_text="The start page offers visitors who have never driven another robot "
                "first.",
                verbose_name="for experienced drivers",
            ),
        ),
    ]
