"""Configuration of the app."""

from django.apps import AppConfig
from django.contrib.auth.signals import user_logged_in
from django.db.models.signals import post_save
from django.utils.translation import gettext_lazy as _


class AccountsConfig(AppConfig):
    name = "accounts"
    verbose_name = _("People")

    def ready(self) -> None:
        from allauth.account.signals import password_reset

        from accounts.audit import note_administration
        from accounts.password_guesses import remember_device

        for signal in (user_logged_in, password_reset):
            signal.connect(remember_device, dispatch_uid="accounts.password_guesses")
        post_save.connect(
            note_administration, sender="admin.LogEntry", dispatch_uid="accounts.audit"
        )
