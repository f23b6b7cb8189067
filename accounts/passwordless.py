"""Guests: accounts without a chosen user name and password.

A link or a button creates a guest, who stays in the browser's session and enters again with an
*entry code* of 40 random bits. Only a hash of it is stored, keyed with the site's secret key,
because all codes could be tried against a plain hash within the hour. A guest may drive robots only
by a rule for their kind (robots.access.register_guest_rule), and may not open the pages about a
password or an address.
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

CODE_LETTERS = "23456789ABCDEFGHJKLMNPQRSTUVWXYZ"  # without similar characters
CODE_LENGTH = 8  # of 32 characters: 40 bits
BACKEND = "django.contrib.auth.backends.ModelBackend"
# A class behind one address creates many at once, but not for hours.
NEW_GUESTS = Attempts("guests", limit=60, seconds=600)
# Counted when a code is refused.
WRONG_CODES = Attempts("entry-codes", limit=10, seconds=300)
# Names of pages for accounts with a user name and password.
FULL_ACCOUNTS_ONLY = frozenset({"profile"}) | {
    f"account_{page}" for page in ("change_password", "email", "reauthenticate", "set_password")
}


def create_guest(kind: str) -> User:
    """Return a new account without a password.

    Args:
        kind: `User.Kind.PARTICIPANT` or `User.Kind.VISITOR`, shown to others instead of a name.

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
    """Log a guest in.

    Raises:
        ValueError: the account is a full one, which only its password opens.
    """
    _require_guest(user)
    login(request, user, backend=BACKEND)


def _require_guest(user: User) -> None:
    if not user.is_guest:
        raise ValueError("a full account is entered with its password")


def sign_out_everywhere(user: User) -> None:
    """End all sessions of a guest, on every device, and their entry code."""
    EntryCode.objects.filter(user=user).delete()
    user.set_unusable_password()  # a new random one: sessions hold a hash of it
    user.save(update_fields=["password"])


# --- entry codes ----------------------------------------------------------------------------------


def new_entry_code(user: User) -> str:
    """Return a guest's new code, such as "K7QM-2XFD", which replaces an earlier one and cannot be
    read again.

    Raises:
        ValueError: the account is a full one.
    """
    _require_guest(user)
    code = "".join(secrets.choice(CODE_LETTERS) for _ in range(CODE_LENGTH))
    EntryCode.objects.update_or_create(
        user=user,
        defaults={"code_hash": _hash(code, settings.SECRET_KEY), "created_at": timezone.now()},
    )
    audit.note("entry_code_made", actor=user, person=user)
    return f"{code[:4]}-{code[4:]}"


def guest_of(code: str) -> User | None:
    """Return the active guest with this code, however it was typed; None if there is none."""
    typed = "".join(one for one in code.upper() if one in CODE_LETTERS)
    if len(typed) != CODE_LENGTH:
        return None
    keys = (settings.SECRET_KEY, *settings.SECRET_KEY_FALLBACKS)
    rows = EntryCode.objects.select_related("user").filter(user__is_active=True)
    row = rows.filter(code_hash__in=[_hash(typed, key) for key in keys]).first()
    return row.user if row is not None and row.user.is_guest else None


def _hash(code: str, key: str) -> str:
    return hmac.new(key.encode(), b"accounts.entry_code:" + code.encode(), "sha256").hexdigest()


# --- pages that are not for guests ----------------------------------------------------------------


def open_to_visitors(view: Callable[..., HttpResponseBase]) -> Callable[..., HttpResponseBase]:
    """Show a view the users who try a simulated robot. Must be the outermost decorator."""

    @functools.wraps(view)
    def opened(*args: Any, **kwargs: Any) -> HttpResponseBase:
        return view(*args, **kwargs)

    opened.is_open_to_visitors = True  # type: ignore[attr-defined]
    return opened


class GuestMiddleware:
    """Middleware: redirects guests from pages about a password, an address or a name of their own,
    with which a study's participant would become a visitor of the whole site. A user who tries a
    simulated robot is anonymous to all views but those that are open to them.
    """

    def __init__(self, get_response: Callable[[HttpRequest], HttpResponseBase]) -> None:
        self._get_response = get_response

    def __call__(self, request: HttpRequest) -> HttpResponseBase:
        return self._get_response(request)

    def process_view(
        self, request: HttpRequest, view: Any, _args: Any, _kwargs: Any
    ) -> HttpResponseBase | None:
        if not getattr(view, "is_open_to_visitors", False):
            user = request.user

            def as_seen() -> Any:
                is_visitor = getattr(user, "kind", "") == User.Kind.VISITOR
                return AnonymousUser() if is_visitor else user

            # lazy: caches may keep a page that does not look at the user
            request.user = SimpleLazyObject(as_seen)
        match = request.resolver_match
        if match is None or match.url_name not in FULL_ACCOUNTS_ONLY:
            return None
        return redirect("own_data") if getattr(request.user, "is_guest", False) else None
