from django.db import migrations, models


class Migration(migrations.Migration):
    dependencies = [("experiments", "0008_verbose_names")]

    operations = [
        migrations.AlterField(
            model_name="study",
            name="entry",
            field=models.CharField(
                choices=[
                    ("open", "open link, with an account"),
                    ("code", "open link, without an account"),
                    ("personal", "personal links only"),
                ],
                default="open",
                max_length=10,
                verbose_name="entry",
            ),
        ),
    ]
