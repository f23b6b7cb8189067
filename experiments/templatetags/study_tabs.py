"""`{% study_tabs study "live" %}`: the one row of tabs on every page of a study.

Some pages are in the administration, which only staff may open, the others are for researchers. A
user's role in the study decides which of them have a tab.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from django import template
from django.urls import reverse
from django.utils.translation import gettext as _

from experiments.access import CODING, OPERATING, RANK, role_of
from experiments.models import Study

register = template.Library()


@dataclass(frozen=True)
class Tab:
    """A page, or several of one subject; `key` is what those pages call it."""

    key: str
    label: str
    url: str


@register.inclusion_tag("components/_tabs.html", takes_context=True)
def study_tabs(context: template.Context, study: Study | None, current: str) -> dict[str, Any]:
    tabs = list(_tabs(context["request"].user, study)) if study else []
    return {"label": _("Pages of the study"), "tabs": tabs, "current": current}


@register.inclusion_tag("components/_tabs.html", takes_context=True)
def sharing_tabs(context: template.Context, study: Study, current: str) -> dict[str, Any]:
    rank = RANK.get(role_of(context["request"].user, study.slug) or "", 0)
    tabs = list(_sharing(study, rank))
    return {"label": _("Sharing"), "tabs": tabs, "current": current, "is_second": True}


def _tabs(user: Any, study: Study) -> Iterator[Tab]:
    role = role_of(user, study.slug) or ""
    rank = RANK.get(role, 0)
    has_admin = rank and user.is_staff
    rows, version, slug = f"?study={study.pk}", f"?version={study.version}", [study.slug]
    if has_admin:
        yield Tab("overview", _("Overview"), _admin("change", study.pk))
        yield Tab("builder", _("Builder"), _admin("section", study.pk, "about"))
        people = reverse("admin:experiments_participant_changelist")
        yield Tab("participants", _("Participants"), people + rows)
    if rank:
        yield Tab("live", _("Live"), reverse("study_live", args=slug))
    if role in OPERATING and study.as_definition().wizard is not None:
        yield Tab("wizard", _("Hidden operator"), reverse("study_wizard", args=slug))
    if has_admin:
        drives = reverse("admin:experiments_drive_changelist")
        yield Tab("drives", _("Drives and replay"), drives + rows)
    if rank or role in CODING:
        yield Tab("coding", _("Coding"), reverse("study_coding", args=slug) + version)
    if rank:
        yield Tab("analysis", _("Analysis"), reverse("analysis", args=slug) + version)
        yield Tab("export", _("Export"), reverse("analysis_export", args=slug) + version)
    if has_admin:
        yield Tab("sharing", _("Sharing"), next(_sharing(study, rank)).url)


def _sharing(study: Study, rank: int) -> Iterator[Tab]:
    if rank >= RANK["researcher"]:
        yield Tab("links", _("Personal links"), _admin("links", study.pk))
        yield Tab("recruitment", _("Recruitment"), _admin("recruitment", study.pk))
    yield Tab("hours", _("Opening hours"), _admin("hours", study.pk))
    yield Tab("members", _("Researchers"), _admin("members", study.pk))


def _admin(page: str, *args: Any) -> str:
    return reverse(f"admin:experiments_study_{page}", args=args)
