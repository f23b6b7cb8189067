"""Django's administration, loaded only by processes that serve its pages.

Its modules import forms that read floor plans, which takes half a second. Broker, session manager
and robots need none of it.
"""

from collections.abc import Sequence
from typing import Any

from django.apps import AppConfig
from django.contrib import admin
from django.contrib.admin import checks as own_checks
from django.contrib.admin.apps import SimpleAdminConfig
from django.core import checks


class AdminConfig(SimpleAdminConfig):
    """The administration; urls.py loads the admin modules of all apps."""

    def ready(self) -> None:
        checks.register(own_checks.check_dependencies, checks.Tags.admin)
        checks.register(check_admin, checks.Tags.admin)


def check_admin(app_configs: Sequence[AppConfig] | None, **_how: Any) -> list[checks.CheckMessage]:
    """Load and check every model's administration."""
    admin.autodiscover()
    found: list[checks.CheckMessage] = own_checks.check_admin_app(app_configs)
    return found
