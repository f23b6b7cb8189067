import django.db.models.deletion
from django.conf import settings
from django.db import migrations, models


class Migration(migrations.Migration):
    dependencies = [("accounts", "0003_verbose_names")]

    operations = [
        migrations.AddField(
            model_name="user",
            name="kind",
            field=models.CharField(
                choices=[
                    ("full", "full account"),
                    ("participant", "participant without password"),
                    ("visitor", "visitor without password"),
                ],
                db_index=True,
                default="full",
                max_length=12,
                verbose_name="kind of account",
            ),
        ),
        migrations.CreateModel(
            name="EntryCode",
            fields=[
                (
                    "user",
                    models.OneToOneField(
                        on_delete=django.db.models.deletion.CASCADE,
                        primary_key=True,
                        related_name="entry_code",
                        serialize=False,
                        to=settings.AUTH_USER_MODEL,
                        verbose_name="user",
                    ),
                ),
                ("code_hash", models.CharField(editable=False, max_length=64, unique=True)),
                ("created_at", models.DateTimeField(verbose_name="created")),
            ],
            options={
                "verbose_name": "entry code",
                "verbose_name_plural": "entry codes",
            },
        ),
    ]
