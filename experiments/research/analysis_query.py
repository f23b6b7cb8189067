"""What the analysis page is asked for: a version of a study, whose drives, and which of them: those
that count, or the sensitivity analysis with the excluded ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from urllib.parse import urlencode

from django.http import Http404, HttpRequest
from django.urls import reverse

from experiments.dataset.levels import Kind
from experiments.dataset.records import COUNTING, EVERY
from experiments.models import ParticipantKind, Study


@dataclass(frozen=True)
class AnalysisQuery:
    """A study's version, kinds of participants, and a selection
    (experiments/analysis/report.py).
    """

    study: Study
    kinds: tuple[Kind, ...]
    selection: str

    def address(self, name: str, *args: object, **more: object) -> str:
        """Return the address of a page that is asked for the same, or for `more`."""
        same = {"version": self.study.version, "kind": self.kinds, "selection": self.selection}
        return (
            reverse(name, args=[self.study.slug, *args]) + "?" + urlencode(same | more, doseq=True)
        )

    @property
    def counts(self) -> bool:
        """Whether it is what the study's results are made of: participants alone."""
        return self.kinds == (ParticipantKind.PARTICIPANT.value,)


def asked_of(request: HttpRequest, slug: str) -> AnalysisQuery:
    """Return what a request asks for; without a version the newest that was published.

    Raises:
        Http404: there is no such version.
    """
    rows = Study.objects.filter(slug=slug).order_by("-version")
    version = request.GET.get("version", "")
    if version:
        rows = (
            rows.filter(version=int(version))
            if version.isdecimal() and len(version) < 6
            else rows.none()
        )
    study = rows.exclude(status=Study.Status.DRAFT).first() or rows.first()
    if study is None:
        raise Http404
    selection = EVERY if request.GET.get("selection") == EVERY else COUNTING
    return AnalysisQuery(study, _kinds(request.GET.getlist("kind")), selection)


def versions_of(study: Study) -> list[int]:
    """Return the numbers of a study's versions, newest first."""
    rows = Study.objects.filter(slug=study.slug).order_by("-version")
    return list(rows.values_list("version", flat=True))


def _kinds(given: Sequence[str]) -> tuple[Kind, ...]:
    known: tuple[Kind, ...] = ("participant", "pilot", "bot")
    return tuple(kind for kind in known if kind in given) or ("participant",)
