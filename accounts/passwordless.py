"""Guests: accounts without a user name and password that somebody chose.

A guest is made by whatever lets them in (a link, a button), stays in the browser's session, and
enters again with an *entry code*. The code has 40 random bits. Only a hash of it is stored, keyed
with the site's secret key, because all codes could be tried against a plain hash within the hour.
What a guest may do on the site is little: robots only by a rule for their kind
(robots.access.register_guest_rule), and none of the pages about a password or an address.
"""

import functools
import hmac
import secrets
from collections.abc import Callable
from typing import Any

from django.conf import settings
from django.contrib.auth import login
from django.contrib.auth.models import AnonymousUser
from django.http import HttpRequest, HttpResponseBase
from django.shortcuts import redirect
from django.utils import timezone
from django.utils.functional import SimpleLazyObject

from accounts import audit
from accounts.attempts import Attempts
from accounts.models import EntryCode, User

CODE_LETTERS = "23456789ABCDEFGHJKLMNPQRSTUVWXYZ"  # nothing that is read as something else
CODE_LENGTH = 8  # of 32 letters: 40 bits
BACKEND = "django.contrib.auth.backends.ModelBackend"
# One address may be a whole class, so that many come at once; nobody makes accounts for hours.
NEW_GUESTS = Attempts("guests", limit=60, seconds=600)
# Codes that nobody has; counted when they are refused.
WRONG_CODES = Attempts("entry-codes", limit=10, seconds=300)
# Addresses that make sense for a user name and password alone.
FULL_ACCOUNTS_ONLY = frozenset(
    {
        "account_change_password",
        "account_email",
        "account_reauthenticate",
        "account_set_password",
        "profile",
    }
)


# --- making one, and letting one in ---------------------------------------------------------------


def create_guest(kind: str) -> User:
    """Return a new account that nobody can log in to with a password.

    Args:
        kind: `User.Kind.PARTICIPANT` or `User.Kind.VISITOR`; others see it instead of a name.

    Raises:
        ValueError: the kind is not that of a guest.
    """
    if kind not in User.Kind.values or kind == User.Kind.FULL:
        raise ValueError(f"{kind} is no kind of guest")
    user = User(username=f"{kind}-{secrets.token_hex(8)}", kind=kind)
    user.set_unusable_password()
    user.save()
    audit.note("guest_created", actor=user, person=user, detail=kind)
    return user


def sign_in(request: HttpRequest, user: User) -> None:
    """Make the browser's session that of a guest.

    Raises:
        ValueError: the account is a full one, which its password opens and nothing else.
    """
    if not user.is_guest:
        raise ValueError("a full account is entered with its password")
    login(request, user, backend=BACKEND)


def sign_out_everywhere(user: User) -> None:
    """End all sessions of a guest, on every device, and their entry code."""
    EntryCode.objects.filter(user=user).delete()
    user.set_unusable_password()  # a new random one: sessions hold a hash of it
    user.save(update_fields=["password"])


# --- entry codes ----------------------------------------------------------------------------------


def new_entry_code(user: User) -> str:
    """Give a guest a code, as in "K7QM-2XFD", instead of an earlier one; nobody can read it again.

    Raises:
        ValueError: the account is a full one.
    """
    if not user.is_guest:
        raise ValueError("a full account is entered with its password")
    code = "".join(secrets.choice(CODE_LETTERS) for _ in range(CODE_LENGTH))
    EntryCode.objects.update_or_create(
        user=user,
        defaults={"code_hash": _hash(code, settings.SECRET_KEY), "created_at": timezone.now()},
    )
    audit.note("entry_code_made", actor=user, person=user)
    return f"{code[:4]}-{code[4:]}"


def guest_of(code: str) -> User | None:
    """Return the guest who has a code, however it was typed; None when nobody has, or their account
    was closed.
    """
    typed = "".join(letter for letter in code.upper() if letter in CODE_LETTERS)
    keys = (settings.SECRET_KEY, *settings.SECRET_KEY_FALLBACKS)
    row = (
        EntryCode.objects.select_related("user")
        .filter(code_hash__in=[_hash(typed, key) for key in keys], user__is_active=True)
        .first()
        if len(typed) == CODE_LENGTH
        else None
    )
    return row.user if row is not None and row.user.is_guest else None


def _hash(code: str, key: str) -> str:
    return hmac.new(key.encode(), b"accounts.entry_code:" + code.encode(), "sha256").hexdigest()


# --- what is not for guests -----------------------------------------------------------------------


def open_to_visitors(view: Callable[..., HttpResponseBase]) -> Callable[..., HttpResponseBase]:
    """Let a view see who tries a simulated robot. To be the outermost decorator."""

    @functools.wraps(view)
    def opened(*args: Any, **kwargs: Any) -> HttpResponseBase:
        return view(*args, **kwargs)

    opened.is_open_to_visitors = True  # type: ignore[attr-defined]
    return opened


def _tries_a_robot(user: Any) -> bool:
    return bool(getattr(user, "kind", "") == User.Kind.VISITOR)


class GuestMiddleware:
    """Middleware: leads guests away from pages about a password, an address or a name of their own,
    with which a study's participant would become a visitor of the whole site. Somebody who tries a
    simulated robot is nobody to all views but those that are open to them.
    """

    def __init__(self, get_response: Callable[[HttpRequest], HttpResponseBase]) -> None:
        self._get_response = get_response

    def __call__(self, request: HttpRequest) -> HttpResponseBase:
        return self._get_response(request)

    def process_view(
        self, request: HttpRequest, view: Any, _args: Any, _kwargs: Any
    ) -> HttpResponseBase | None:
        """Lead to what is kept of the guest instead."""
        if not getattr(view, "is_open_to_visitors", False):
            # when it is asked for: a page that asks for no user may be kept by caches
            user = request.user
            request.user = SimpleLazyObject(
                lambda: AnonymousUser() if _tries_a_robot(user) else user
            )
        match = request.resolver_match
        if match is None or match.url_name not in FULL_ACCOUNTS_ONLY:
            return None
        return redirect("own_data") if getattr(request.user, "is_guest", False) else None
