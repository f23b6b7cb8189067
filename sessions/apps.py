"""Configuration of the app."""

from django.apps import AppConfig
from django.utils.translation import gettext_lazy as _


class TelepresenceSessionsConfig(AppConfig):
    """Visits to robots. The label differs from the package because Django has an app called
    sessions.
    """

    name = "sessions"
    label = "telepresence_sessions"
    verbose_name = _("Sessions with robots")
