"""The site itself: what joins the apps."""

from django.apps import AppConfig


class TelepresenceSiteConfig(AppConfig):
    """Holds the commands and system checks that need every app."""

    name = "telepresence_site"
    verbose_name = "Telepresence site"

    def ready(self) -> None:
        """Register the system checks."""
        from telepresence_site import checks  # noqa: PLC0415 -- settings are complete only now

        checks.register_all()
