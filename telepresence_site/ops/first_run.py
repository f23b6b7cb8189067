"""The first page of a fresh site creates its administrator, and then shows what is still missing.

It exists only while the site has no account. On any address but this computer's own it asks for a
code (fresh_site.py), which the web process writes to its log and `manage.py doctor` prints:
only people who run the site can read these.
"""

import functools
import ipaddress
import uuid
from collections.abc import Callable
from typing import Any, ClassVar

import structlog
from django import forms
from django.conf import settings
from django.contrib.auth import login
from django.contrib.auth.decorators import user_passes_test
from django.contrib.auth.forms import BaseUserCreationForm
from django.db import IntegrityError, transaction
from django.http import HttpRequest, HttpResponse, HttpResponseBase
from django.shortcuts import redirect, render
from django.utils import timezone
from django.utils.crypto import constant_time_compare
from django.utils.translation import gettext as _, gettext_lazy
from django.views.decorators.cache import never_cache
from django.views.decorators.debug import sensitive_post_parameters
from django.views.decorators.http import require_http_methods, require_safe

from accounts.attempts import Attempts
from accounts.models import AuditEntry, User
from accounts.rate_limits import limited
from telepresence_site.checks import LOOPBACK_NAMES
from telepresence_site.ops.doctor.services import examine_site
from telepresence_site.ops.fresh_site import is_fresh, setup_code

log = structlog.stdlib.get_logger(__name__)
BACKEND = "django.contrib.auth.backends.ModelBackend"
CODES = Attempts("first-run", limit=10)
# The audit entry of the first administrator has a fixed key: of two people who create one at the
# same time, the second cannot add it.
FIRST_ENTRY = uuid.uuid5(uuid.NAMESPACE_DNS, "first-administrator.telepresence")
FORWARDED = ("HTTP_X_FORWARDED_FOR", "HTTP_FORWARDED", "HTTP_X_REAL_IP", "HTTP_VIA")


class AlreadySetUpError(RuntimeError):
    """Another request created the first administrator."""


class AdministratorForm(BaseUserCreationForm):
    code = forms.CharField(
        label=gettext_lazy("Code"),
        help_text=gettext_lazy(
            "It is in the log of the web server. On the server, “manage.py doctor” prints it, too."
        ),
        widget=forms.TextInput(attrs={"autocomplete": "off", "spellcheck": "false"}),
    )

    class Meta:
        model = User
        fields = ("username", "email")
        labels: ClassVar = {"username": gettext_lazy("User name"), "email": gettext_lazy("E-mail")}
        help_texts: ClassVar = {"username": gettext_lazy("Letters, digits and @ . + - _")}

    def __init__(self, *args: Any, needs_code: bool, **options: Any) -> None:
        super().__init__(*args, **options)
        self.fields["password2"].label = _("Repeat the password")
        self.fields["password1"].help_text = self.fields["password2"].help_text = ""
        if needs_code:
            self.order_fields(["code"])
        else:
            del self.fields["code"]

    def clean_code(self) -> str:
        if not constant_time_compare(self.cleaned_data["code"].strip().lower(), setup_code()):
            raise forms.ValidationError(_("This is not the code."))
        return setup_code()


def is_from_here(request: HttpRequest) -> bool:
    """Tell whether the browser runs on this computer. Behind a proxy, all requests seem to come
    from here, and none counts.
    """
    if settings.TRUSTED_PROXIES or getattr(settings, "SECURE_PROXY_SSL_HEADER", None):
        return False
    if any(name in request.META for name in FORWARDED):
        return False
    try:
        sender = ipaddress.ip_address(request.META.get("REMOTE_ADDR", ""))
    except ValueError:
        return False
    host = request.get_host().rpartition(":")[0] or request.get_host()
    return sender.is_loopback and host in LOOPBACK_NAMES - {"testserver"}


@functools.cache
def log_code(page: str) -> None:
    """Log the code once in each process."""
    log.warning("first_administrator_missing", page=page, enter=setup_code())


def or_setup(view: Callable[..., HttpResponse]) -> Callable[..., HttpResponseBase]:
    """Lead from the view to the first page while the site is fresh."""

    @functools.wraps(view)
    def view_or_setup(request: HttpRequest, *args: Any, **options: Any) -> HttpResponseBase:
        return redirect("setup") if is_fresh() else view(request, *args, **options)

    return view_or_setup


@never_cache
@sensitive_post_parameters("code", "password1", "password2")
@require_http_methods(["GET", "HEAD", "POST"])
@limited(CODES)
def setup(request: HttpRequest) -> HttpResponse:
    if not is_fresh():
        return redirect("home")
    needs_code = not is_from_here(request)
    if needs_code:
        log_code(request.path)
    form = AdministratorForm(request.POST or None, needs_code=needs_code)
    if request.method == "POST" and form.is_valid():
        try:
            user = create_administrator(form)
        except AlreadySetUpError:
            form.add_error(None, _("Somebody else has just set up this site. Log in instead."))
        else:
            login(request, user, backend=BACKEND)
            return redirect("site_checks")
    return render(request, "site/setup.html", {"form": form})


def create_administrator(form: AdministratorForm) -> User:
    """Create the first administrator.

    Raises:
        AlreadySetUpError: another request was first.
    """
    user = form.save(commit=False)
    user.is_staff = user.is_superuser = True
    entry = AuditEntry(
        id=FIRST_ENTRY,
        at=timezone.now(),
        act="first_administrator",
        actor=user.pk,
        person=user.pk,
    )
    try:
        with transaction.atomic():
            entry.save(force_insert=True)
            if User.objects.filter(kind=User.Kind.FULL).exists():
                raise AlreadySetUpError
            user.save()
    except IntegrityError as error:
        raise AlreadySetUpError from error
    return user


@never_cache
@user_passes_test(lambda user: user.is_active and user.is_superuser)
@require_safe
def site_checks(request: HttpRequest) -> HttpResponse:
    """Show what `manage.py doctor` prints."""
    found = examine_site()
    return render(request, "site/checks.html", {"found": found})
