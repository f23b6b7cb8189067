"""Configuration of the app."""

from django.apps import AppConfig
from django.utils.translation import gettext_lazy as _


class ExperimentsConfig(AppConfig):
    name = "experiments"
    verbose_name = _("Research")

    def ready(self) -> None:
        from experiments import signal_handlers

        signal_handlers.connect()
