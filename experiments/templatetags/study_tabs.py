"""`{% study_tabs study "live" %}`: the one row of tabs on every page of a study.

The pages stand in the administration, where only staff comes in, and among the pages for
researchers; which of them somebody may open follows from their role in the study. A person without
a part in the study sees no tabs, whatever else they may look at.
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
    """Return the tabs of a study for whoever asks, the present one marked."""
    tabs = tabs_of(context["request"].user, study) if study else []
    return {"label": _("Pages of the study"), "tabs": tabs, "current": current}


@register.inclusion_tag("components/_tabs.html", takes_context=True)
def sharing_tabs(context: template.Context, study: Study, current: str) -> dict[str, Any]:
    """Return the tabs of the pages on sharing a study, below those of the study."""
    tabs = list(_sharing(study, _rank(context["request"].user, study)))
    return {"label": _("Sharing"), "tabs": tabs, "current": current, "is_second": True}


def tabs_of(user: Any, study: Study) -> list[Tab]:
    """Return the tabs of a study that somebody may open, in their order."""
    role = role_of(user, study.slug) or ""
    rank = RANK.get(role, 0)
    if not rank and role in CODING:
        return [_coding(study)]
    tabs = list(_tabs(study, rank, is_staff=user.is_staff)) if rank else []
    if role in OPERATING and study.as_definition().wizard is not None:
        wizard = Tab("wizard", _("Hidden operator"), reverse("study_wizard", args=[study.slug]))
        live = next((i for i, tab in enumerate(tabs) if tab.key == "live"), len(tabs) - 1)
        tabs.insert(live + 1, wizard)
    return tabs


def _rank(user: Any, study: Study) -> int:
    return RANK.get(role_of(user, study.slug) or "", 0)


def _tabs(study: Study, rank: int, *, is_staff: bool) -> Iterator[Tab]:
    rows, version = f"?study={study.pk}", f"?version={study.version}"
    if is_staff:
        yield Tab("overview", _("Overview"), _admin("change", study.pk))
        yield Tab("builder", _("Builder"), _admin("section", study.pk, "about"))
        people = reverse("admin:experiments_participant_changelist")
        yield Tab("participants", _("Participants"), people + rows)
    yield Tab("live", _("Live"), reverse("study_live", args=[study.slug]))
    if is_staff:
        drives = reverse("admin:experiments_drive_changelist")
        yield Tab("drives", _("Drives and replay"), drives + rows)
    yield _coding(study)
    yield Tab("analysis", _("Analysis"), reverse("analysis", args=[study.slug]) + version)
    yield Tab("export", _("Export"), reverse("analysis_export", args=[study.slug]) + version)
    if is_staff:
        yield Tab("sharing", _("Sharing"), next(_sharing(study, rank)).url)


def _coding(study: Study) -> Tab:
    version = f"?version={study.version}"
    return Tab("coding", _("Coding"), reverse("study_coding", args=[study.slug]) + version)


def _sharing(study: Study, rank: int) -> Iterator[Tab]:
    if rank >= RANK["researcher"]:
        yield Tab("links", _("Personal links"), _admin("links", study.pk))
        yield Tab("recruitment", _("Recruitment"), _admin("recruitment", study.pk))
    yield Tab("hours", _("Opening hours"), _admin("hours", study.pk))
    yield Tab("members", _("Researchers"), _admin("members", study.pk))


def _admin(page: str, *args: Any) -> str:
    return reverse(f"admin:experiments_study_{page}", args=args)
