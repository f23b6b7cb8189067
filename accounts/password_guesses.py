"""Limits on wrong passwords.

Each address may guess a few passwords for an account, and all addresses together a limited number,
against attackers with many addresses. A device that has logged in to the account before, recognized
by a signed cookie, has a limit of its own, which guesses from elsewhere do not use up (OWASP, "Slow
Down Online Guessing Attacks with Device Cookies"). The cookie allows nothing without the password.
"""

import secrets
from collections.abc import Callable
from typing import Any

from allauth.account.utils import filter_users_by_email
from django.conf import settings
from django.core import signing
from django.http import HttpRequest, HttpResponseBase
from django.urls import reverse
from django.utils.crypto import salted_hmac

from accounts.attempts import Attempts, address_of
from accounts.models import User

SOURCE_GUESSES = Attempts("password-source", limit=5, seconds=300)  # account and address or device
ACCOUNT_GUESSES = Attempts("password-account", limit=30, seconds=3600)  # from unknown devices
DEVICE_COOKIE = "device"
DEVICE_SECONDS = 365 * 24 * 3600
ACCOUNTS_PER_DEVICE = 8  # the newest; a cookie has little room
SALT = "accounts.password_guesses"


class PasswordGuess:
    """One attempt to log in to an account, counted before the password is checked.

    Args:
        request: the log-in.
        credentials: what was entered: `username`, `email` or both.
        now: Unix time in seconds.
    """

    def __init__(self, request: HttpRequest, credentials: dict[str, Any], now: float) -> None:
        self._now = now
        account = _account(credentials)
        device, accounts = _device(request)
        known = account in accounts
        source = device if known else address_of(request)
        self._limits = [(SOURCE_GUESSES, f"{account}:{source}")]
        if not known:
            self._limits.append((ACCOUNT_GUESSES, account))
        self._counted: list[tuple[Attempts, str]] = []

    def count(self) -> int:
        """Count the guess. Return 0, or the seconds to wait if it is not allowed."""
        for attempts, key in self._limits:
            if not attempts.count(key, self._now):
                self.take_back()
                return attempts.wait(key, self._now)
            self._counted.append((attempts, key))
        return 0

    def take_back(self) -> None:
        """Undo `count`: the password was right, or was not checked."""
        for attempts, key in self._counted:
            attempts.take_back(key, self._now)
        self._counted.clear()


class DeviceMiddleware:
    """Marks a device as known after a log-in or a new password."""

    def __init__(self, get_response: Callable[[HttpRequest], HttpResponseBase]) -> None:
        self._get_response = get_response

    def __call__(self, request: HttpRequest) -> HttpResponseBase:
        response = self._get_response(request)
        user = getattr(request, "device_user", None)
        if user is not None:
            _set_cookie(request, response, _tag(str(user.pk)))
        return response


def remember_device(request: HttpRequest | None, user: User, **_more: Any) -> None:
    """Have DeviceMiddleware set the cookie: the user logged in, or set a new password."""
    if request is not None and not user.is_guest:
        request.device_user = user


def _set_cookie(request: HttpRequest, response: HttpResponseBase, account: str) -> None:
    device, accounts = _device(request)
    recent = [account, *(other for other in accounts if other != account)][:ACCOUNTS_PER_DEVICE]
    response.set_cookie(
        DEVICE_COOKIE,
        signing.dumps([device, *recent], salt=SALT),
        max_age=DEVICE_SECONDS,
        path=reverse("account_login").removesuffix("login/"),
        secure=settings.SESSION_COOKIE_SECURE,
        httponly=True,
        samesite="Lax",
    )


def _device(request: HttpRequest) -> tuple[str, list[str]]:
    """Return the device's random id, a new one without a cookie, and the accounts that logged in
    on it.
    """
    try:
        device, *accounts = signing.loads(
            request.COOKIES.get(DEVICE_COOKIE, ""), salt=SALT, max_age=DEVICE_SECONDS
        )
    except signing.BadSignature:
        return secrets.token_urlsafe(9), []
    return device, accounts


def _account(credentials: dict[str, Any]) -> str:
    """Return the same key for an account whether its user name or its e-mail was entered."""
    name, email = credentials.get("username") or "", credentials.get("email") or ""
    users = (
        filter_users_by_email(email) if email else list(User.objects.filter(username__iexact=name))
    )
    return _tag(str(users[0].pk) if users else (email or name).lower())


def _tag(account: str) -> str:
    """Return a keyed hash of an account for the cookie and the cache, without personal data."""
    return str(salted_hmac(SALT, account).hexdigest()[:24])
