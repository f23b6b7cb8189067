"""States are found in the order in which they were received, and PostgreSQL takes the room of
deleted ones back sooner.
"""

from django.db import migrations, models


def vacuum_sooner(_apps, schema_editor):
    """Have autovacuum begin when a fiftieth of the states is dead, instead of a fifth: with a year
    kept, after a week of nights instead of after ten.
    """
    if schema_editor.connection.vendor == "postgresql":
        schema_editor.execute(
            "ALTER TABLE telepresence_sessions_statechunk"
            " SET (autovacuum_vacuum_scale_factor = 0.02)"
        )


class Migration(migrations.Migration):
    dependencies = [("telepresence_sessions", "0012_shards")]

    operations = [
        migrations.AddIndex(
            model_name="statechunk",
            index=models.Index(
                fields=["session", "received_at", "first_seq"], name="states_in_order"
            ),
        ),
        migrations.RunPython(vacuum_sooner, migrations.RunPython.noop),
    ]
