from django.db import migrations, models


class Migration(migrations.Migration):
    dependencies = [("experiments", "0009_entry_without_account")]

    operations = [
        migrations.AddField(
            model_name="study",
            name="deviations",
            field=models.TextField(
                blank=True,
                default="",
                help_text="What was done differently, when and why. It is exported with the data.",
                verbose_name="deviations from the plan",
            ),
            preserve_default=False,
        ),
    ]
