"""What pages call the publication details of a study, and where their page is."""

from collections.abc import Sequence
from typing import Any

from django.urls import reverse
from django.utils.translation import gettext_lazy as _

from experiments.models import Study

LABELS = {
    "authors": _("Authors"),
    "license": _("Licence"),
    "funder": _("Funder"),
    "preregistration": _("Preregistration"),
    "doi": _("DOI"),
    "keywords": _("Keywords"),
    "ethics": _("Ethics approval"),
}


def labels_of(names: Sequence[str]) -> list[str]:
    """Return what the pages call fields of the publication details."""
    return [str(LABELS[name]) for name in names]


def details_page(user: Any, study: Study) -> str:
    """Return the address of the page that shows them, empty for whoever has no administration."""
    if not user.is_staff:
        return ""
    return reverse("admin:experiments_study_publication", args=[study.pk])
