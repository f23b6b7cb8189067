"""Robots are divided into shards, which several session managers share."""

import uuid

from django.db import migrations, models


class Migration(migrations.Migration):
    dependencies = [("telepresence_sessions", "0011_wizard_lease")]

    operations = [
        migrations.AddField(
            model_name="managerbeat",
            name="beats",
            field=models.BigIntegerField(default=0, editable=False),
        ),
        migrations.CreateModel(
            name="Shard",
            fields=[
                (
                    "id",
                    models.UUIDField(
                        default=uuid.uuid4, editable=False, primary_key=True, serialize=False
                    ),
                ),
                ("number", models.PositiveSmallIntegerField(unique=True)),
                ("owner", models.CharField(blank=True, max_length=64)),
                ("epoch", models.BigIntegerField(default=0)),
            ],
            options={"verbose_name": "shard", "verbose_name_plural": "shards"},
        ),
    ]
