from django.db import migrations, models


class Migration(migrations.Migration):
    dependencies = [("experiments", "0010_study_deviations")]

    operations = [
        migrations.AddField(
            model_name="study",
            name="publication",
            field=models.JSONField(
                blank=True, default=dict, editable=False, verbose_name="publication details"
            ),
        ),
        migrations.AddField(
            model_name="study",
            name="deposits",
            field=models.JSONField(blank=True, default=dict, editable=False),
        ),
    ]
