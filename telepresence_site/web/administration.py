"""Django's administration, loaded by those who serve its pages only.

Its modules bring forms that read floor plans, with everything that computes on them: half a second
of a process's start. Broker, session manager and robots need none of it.
"""

from collections.abc import Sequence
from typing import Any

from django.apps import AppConfig
from django.contrib import admin
from django.contrib.admin import checks as own_checks
from django.contrib.admin.apps import SimpleAdminConfig
from django.core import checks


class AdminConfig(SimpleAdminConfig):
    """The administration; urls.py loads every app's part of it."""

    def ready(self) -> None:
        checks.register(own_checks.check_dependencies, checks.Tags.admin)
        checks.register(check_admin, checks.Tags.admin)


def check_admin(app_configs: Sequence[AppConfig] | None, **_how: Any) -> list[checks.CheckMessage]:
    """Check every model's administration, which may not have been loaded yet."""
    admin.autodiscover()
    found: list[checks.CheckMessage] = own_checks.check_admin_app(app_configs)
    return found
