"""Configuration of the app."""

from django.apps import AppConfig
from django.db.models.signals import post_save
from django.utils.translation import gettext_lazy as _


class AccountsConfig(AppConfig):
    """People, and how they log in."""

    name = "accounts"
    verbose_name = _("People")

    def ready(self) -> None:
        """Have the audit log hear of what is done in the administration."""
        from accounts.audit import (
            note_administration,
        )

        post_save.connect(
            note_administration, sender="admin.LogEntry", dispatch_uid="accounts.audit"
        )
