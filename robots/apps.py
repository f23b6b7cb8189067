"""Configuration of the app."""

from django.apps import AppConfig


class RobotsConfig(AppConfig):
    """Robots."""

    name = "robots"
    verbose_name = "Robots"
