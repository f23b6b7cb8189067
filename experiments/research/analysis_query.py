"""The query of an analysis page: a version of a study, whose drives, and which of them."""

from dataclasses import dataclass
from typing import get_args
from urllib.parse import urlencode

from django.http import HttpRequest
from django.urls import reverse

from experiments.dataset.levels import Kind
from experiments.dataset.records import COUNTING, EVERY
from experiments.models import Study
from experiments.research.study_access import version_of


@dataclass(frozen=True)
class AnalysisQuery:
    """A study's version, kinds of participants, and a selection (experiments/analysis/report.py).
    `report` is the key of the report that a page shows; empty for the current one.
    """

    study: Study
    kinds: tuple[Kind, ...]
    selection: str
    report: str = ""

    def address(self, name: str, *args: object, **changes: object) -> str:
        same = {"version": self.study.version, "kind": self.kinds}
        same |= {"selection": self.selection, "report": self.report}
        query = {key: value for key, value in (same | changes).items() if value}
        return f"{reverse(name, args=[self.study.slug, *args])}?{urlencode(query, doseq=True)}"

    @property
    def counts(self) -> bool:
        """Whether it selects what the study's results are made of: participants alone."""
        return self.kinds == ("participant",)


def asked_of(request: HttpRequest, slug: str) -> AnalysisQuery:
    """Return the query of a request; without a version that of the newest published one, and
    Http404 for an unknown one.
    """
    given = request.GET.getlist("kind")
    kinds = tuple(kind for kind in get_args(Kind) if kind in given) or ("participant",)
    selection = EVERY if request.GET.get("selection") == EVERY else COUNTING
    study = version_of(slug, request.GET.get("version", ""))
    return AnalysisQuery(study, kinds, selection, request.GET.get("report", ""))


def versions_of(study: Study) -> list[int]:
    rows = Study.objects.filter(slug=study.slug).order_by("-version")
    return list(rows.values_list("version", flat=True))
