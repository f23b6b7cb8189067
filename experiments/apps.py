"""Configuration of the app."""

from django.apps import AppConfig
from django.utils.translation import gettext_lazy as _


class ExperimentsConfig(AppConfig):
    """Studies, who takes part in them, and what came of it."""

    name = "experiments"
    verbose_name = _("Studies")

    def ready(self) -> None:
        """Answer for the terms of participants' visits, and listen to the session manager."""
        from experiments import signal_handlers

        signal_handlers.connect()
