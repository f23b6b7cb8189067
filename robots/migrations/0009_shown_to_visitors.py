"""Robots can be hidden from visitors; those that exist stay shown."""

from django.db import migrations, models


class Migration(migrations.Migration):
    """Shown is the default, so no row needs a change."""

    dependencies = [
        ("robots", "0008_verbose_names"),
    ]

    operations = [
        migrations.AddField(
            model_name="robot",
            name="shown_to_visitors",
            field=models.BooleanField(
                default=True,
                help_text="Visitors see the robot and can drive it. Available once the robot has "
                "connected. You and its operators can always drive it.",
                verbose_name="show to visitors",
            ),
        ),
    ]
