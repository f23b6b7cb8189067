"""The site itself: what joins the apps."""

from django.apps import AppConfig
from django.utils.translation import gettext_lazy as _


class TelepresenceSiteConfig(AppConfig):
    """Has the commands and system checks that need every app."""

    name = "telepresence_site"
    verbose_name = _("Telepresence site")

    def ready(self) -> None:
        from telepresence_site import checks  # noqa: F401 -- its import registers them
