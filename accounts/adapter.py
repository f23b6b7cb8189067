"""Adapters of django-allauth for this site's accounts."""

import time
from email.utils import formataddr, parseaddr
from typing import Any

from allauth.account.adapter import DefaultAccountAdapter
from allauth.core import context
from django.conf import settings
from django.contrib.auth.base_user import AbstractBaseUser
from django.core.exceptions import ValidationError
from django.forms import BaseForm
from django.http import HttpRequest
from django.utils.translation import gettext

from accounts.attempts import address_of
from accounts.models import User
from accounts.password_guesses import PasswordGuess

INVITED = "invited"  # in the session of a browser that opened an invitation
LIMITS_MET = frozenset({"too_many_login_attempts", "rate_limited"})


class AccountAdapter(DefaultAccountAdapter):
    """Adds the shown name to sign-up, and closes sign-up if the site does."""

    def is_open_for_signup(self, request: HttpRequest) -> bool:
        """Tell whether visitors may create accounts; invited colleagues always may."""
        return settings.SIGNUP_OPEN or bool(request.session.get(INVITED))

    def get_client_ip(self, request: HttpRequest) -> str:
        """Return the address that attempts are counted by, behind our proxies the visitor's."""
        return address_of(request)

    def get_from_email(self) -> str:
        """Return the sender, with the site's name unless the setting has one."""
        name, address = parseaddr(settings.DEFAULT_FROM_EMAIL)
        return formataddr((name or gettext("Telepresence"), address))

    def pre_authenticate(self, request: HttpRequest, **credentials: Any) -> None:
        """Count a guess before the password is checked; see accounts/password_guesses.py.

        Raises:
            ValidationError: it is one too many.
        """
        super().pre_authenticate(request, **credentials)
        self._guess = PasswordGuess(request, credentials, time.time())
        wait = self._guess.count()
        if wait:
            request.retry_after = wait
            raise self.validation_error("too_many_login_attempts")

    def authenticate(self, request: HttpRequest, **credentials: Any) -> AbstractBaseUser | None:
        """Return the user whose password is right; only wrong passwords count as guesses."""
        user = super().authenticate(request, **credentials)
        if user:
            self._guess.take_back()
        return user

    def validation_error(self, code: str, *args: Any) -> ValidationError:
        """Mark the request when a limit was reached: allauth reports it in the form only, and
        accounts/rate_limits.py in the status code as well.
        """
        if code in LIMITS_MET and context.request is not None:
            context.request.limit_met = True
        return super().validation_error(code, *args)

    def save_user(
        self, request: HttpRequest, user: User, form: BaseForm, commit: bool = True
    ) -> User:
        user.display_name = form.cleaned_data.get("display_name", "")
        return super().save_user(request, user, form, commit=commit)
