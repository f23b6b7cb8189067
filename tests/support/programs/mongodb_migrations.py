"""Prints as JSON which migrations a MongoDB site would have, and whether they are complete; needs
no server.

`python -m tests.support.programs.mongodb_migrations`, with DATABASE_URL naming a MongoDB.
"""

import json
import sys

import django


def main() -> None:
    django.setup()
    from django.apps import apps
    from django.db import connection
    from django.db.migrations.autodetector import MigrationAutodetector
    from django.db.migrations.loader import MigrationLoader
    from django.db.migrations.questioner import NonInteractiveMigrationQuestioner
    from django.db.migrations.state import ProjectState

    loader = MigrationLoader(None)
    wanted = ProjectState.from_apps(apps)
    missing = MigrationAutodetector(
        loader.project_state(), wanted, NonInteractiveMigrationQuestioner()
    ).changes(graph=loader.graph)
    keys = {
        model._meta.label: type(model._meta.pk).__name__
        for model in apps.get_models(include_auto_created=True)
    }
    operations = {
        type(operation).__name__
        for migration in loader.disk_migrations.values()
        for operation in migration.operations
    }
    answer = {
        "vendor": connection.vendor,
        "missing": {app: len(found) for app, found in missing.items()},
        "keys": keys,
        "operations": sorted(operations),
    }
    sys.stdout.write(json.dumps(answer))


if __name__ == "__main__":
    main()
