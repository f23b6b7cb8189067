"""People: visitors, researchers, robot owners."""

import uuid
from typing import Any, NoReturn

from django.contrib.auth.models import AbstractUser
from django.db import models
from django.utils.translation import gettext_lazy as _

# What a guest without a chosen name is called: in a message, and on a page. A user name cannot have
# parentheses.
GUEST_NAMES = {"(participant)": _("Participant"), "(visitor)": _("Guest")}


class User(AbstractUser):
    """Every person who signs in. The key is a UUID: all supported databases have them, and they
    reveal nothing.
    """

    class Kind(models.TextChoices):
        """The purpose of an account. Only a full one has a user name and password chosen by a
        person; robots/access.py and accounts/passwordless.py limit the others.
        """

        FULL = "full", _("full account")
        PARTICIPANT = "participant", _("participant without password")
        VISITOR = "visitor", _("visitor without password")

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    display_name = models.CharField(_("name shown to others"), max_length=60, blank=True)
    kind = models.CharField(
        _("kind of account"), max_length=12, choices=Kind, default=Kind.FULL, db_index=True
    )

    class Meta:
        verbose_name = _("user")
        verbose_name_plural = _("users")

    @property
    def shown_name(self) -> str:
        """The name that other visitors and people at the robot see, in the reader's language; never
        the e-mail address.
        """
        return str(GUEST_NAMES.get(self.sent_name, self.sent_name))

    @property
    def sent_name(self) -> str:
        """The shown name in a message, whose readers have different languages: for a guest without
        a chosen name the kind, which each page translates (static/js/lib/words.js).
        """
        return self.display_name or (f"({self.kind})" if self.is_guest else self.username)

    @property
    def is_guest(self) -> bool:
        return self.kind != self.Kind.FULL


class EntryCode(models.Model):
    """A keyed hash of the code with which a guest enters again (accounts/passwordless.py)."""

    user = models.OneToOneField(
        User, models.CASCADE, primary_key=True, related_name="entry_code", verbose_name=_("user")
    )
    code_hash = models.CharField(max_length=64, unique=True, editable=False)
    created_at = models.DateTimeField(_("created"))

    class Meta:
        verbose_name = _("entry code")
        verbose_name_plural = _("entry codes")

    def __str__(self) -> str:
        return str(self.user_id)


class AppendOnlyError(RuntimeError):
    """Code tried to change or delete an entry of the audit log."""


class AuditEntries(models.QuerySet["AuditEntry"]):
    """Entries, which are only added. `accounts.audit.forget` and `accounts.audit.unlink`, the only
    exceptions, use a plain QuerySet.
    """

    def update(self, **_values: Any) -> NoReturn:
        raise AppendOnlyError("an audit entry cannot be changed")

    def delete(self) -> NoReturn:
        raise AppendOnlyError("an audit entry cannot be deleted")


class AuditEntry(models.Model):
    """Who did what to whom, and when; of a person only the id, which means nothing after the
    account is deleted.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    at = models.DateTimeField(_("time"), db_index=True)
    # Ids and names, not foreign keys: an entry outlives what it is about.
    actor = models.UUIDField(_("done by"), null=True, db_index=True)
    act = models.CharField(_("action"), max_length=40, db_index=True)
    person = models.UUIDField(_("person affected"), null=True, db_index=True)
    robot = models.CharField(_("robot"), max_length=63, blank=True, db_index=True)
    study = models.CharField(_("study"), max_length=40, blank=True, db_index=True)
    thing = models.CharField(_("item"), max_length=80, blank=True)
    detail = models.CharField(_("detail"), max_length=200, blank=True)
    # The role of who intervened in a robot's safety (accounts/interventions.py), and with which
    # figures; never about a person.
    role = models.CharField(_("role"), max_length=20, blank=True)
    data = models.JSONField(_("data"), default=dict, blank=True)

    objects = AuditEntries.as_manager()

    class Meta:
        verbose_name = _("audit entry")
        verbose_name_plural = _("audit log")
        ordering = ("-at",)

    def __str__(self) -> str:
        return self.act

    def save(self, **options: Any) -> None:
        if not self._state.adding:
            raise AppendOnlyError("an audit entry cannot be changed")
        super().save(**options)

    def delete(self, *_args: Any, **_options: Any) -> NoReturn:
        raise AppendOnlyError("an audit entry cannot be deleted")
