"""People: visitors, researchers, robot owners."""

import uuid
from typing import Any, NoReturn

from django.contrib.auth.models import AbstractUser
from django.db import models
from django.utils.translation import gettext_lazy as _


class User(AbstractUser):
    """Anybody who signs in. The key is a UUID, which every supported database can hold and which
    tells nothing.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    display_name = models.CharField(_("name shown to others"), max_length=60, blank=True)

    class Meta:
        verbose_name = _("user")
        verbose_name_plural = _("users")

    @property
    def shown_name(self) -> str:
        """What other visitors and people beside the robot see; never the e-mail address."""
        return self.display_name or self.username


class AppendOnlyError(RuntimeError):
    """An entry of the audit log was to be changed or deleted."""


class AuditEntries(models.QuerySet["AuditEntry"]):
    """Entries, which are only ever added; `accounts.audit.forget` alone takes old ones away."""

    def update(self, **_values: Any) -> NoReturn:
        """Refuse."""
        raise AppendOnlyError("an audit entry never changes")

    def delete(self) -> NoReturn:
        """Refuse."""
        raise AppendOnlyError("an audit entry is not deleted")


class AuditEntry(models.Model):
    """Who did what to whom, when; nothing of a person but the id, which leads to nobody once the
    account is deleted.
    """

    id = models.UUIDField(primary_key=True, default=uuid.uuid4, editable=False)
    at = models.DateTimeField(_("at"), db_index=True)
    # Ids and names of things, not references: an entry outlives what it speaks of.
    actor = models.UUIDField(_("who"), null=True, db_index=True)
    act = models.CharField(_("did"), max_length=40, db_index=True)
    person = models.UUIDField(_("to whom"), null=True, db_index=True)
    robot = models.CharField(_("robot"), max_length=63, blank=True, db_index=True)
    study = models.CharField(_("study"), max_length=40, blank=True, db_index=True)
    thing = models.CharField(_("thing"), max_length=80, blank=True)
    detail = models.CharField(_("detail"), max_length=200, blank=True)

    objects = AuditEntries.as_manager()

    class Meta:
        verbose_name = _("audit entry")
        verbose_name_plural = _("audit log")
        ordering = ("-at",)

    def __str__(self) -> str:
        return self.act

    def save(self, **options: Any) -> None:
        """Add the entry.

        Raises:
            AppendOnlyError: it is there already.
        """
        if not self._state.adding:
            raise AppendOnlyError("an audit entry never changes")
        super().save(**options)

    def delete(self, *_args: Any, **_options: Any) -> NoReturn:
        """Refuse."""
        raise AppendOnlyError("an audit entry is not deleted")
