"""The columns of a robot that robots/migrations/0017_presence_and_credentials.py has copied."""

from importlib import import_module

from django.db import migrations

PARTS = import_module("robots.migrations.0017_presence_and_credentials").PARTS


class Migration(migrations.Migration):
    dependencies = [("robots", "0017_presence_and_credentials")]
    operations = [
        migrations.RemoveField(model_name="robot", name=name)
        for _model, names in PARTS
        for name in names
    ]
