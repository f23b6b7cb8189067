"""The page of the publication details that a study's dataset carries in a repository."""

from collections.abc import Iterator

import msgspec
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseRedirect
from django.utils.translation import gettext, gettext_lazy as _

from experiments.access import may
from experiments.builder.study_page import StudyPages, study_view
from experiments.definition import publication
from experiments.definition.publication import LICENCES, PublicationDetails
from experiments.models import Study
from experiments.research.analysis_downloads import PUBLICATION, PUBLICATION_LABELS, labels_of
from experiments.research.study_access import note_change
from surveys.document_forms.guide import FormGuide, column_of
from surveys.document_forms.part_form import PartForm
from surveys.document_forms.parts import Document

EMPTY_ROWS = 3  # for more authors
NO_ORCID = _("%(text)s is not an ORCID iD: its check digit or its format is wrong.")
NO_DOI = _("%(text)s is not a DOI such as 10.5281/zenodo.1234567.")
GUIDE = FormGuide(
    PUBLICATION_LABELS,
    column_of(PUBLICATION, "hint", _),
    column_of(PUBLICATION, "item", _),
    choices={},
    spaced=frozenset({"keywords"}),
)


class DetailsForm(PartForm):
    guide = GUIDE


class PublicationPages(StudyPages):
    @study_view("publication/", "publication")
    def publication_view(self, request: HttpRequest, row: Study) -> HttpResponse:
        """Show the details; owners change them, also after the study was published."""
        is_owner = may(request.user, row.slug, "owner")
        details = publication.from_stored(row.publication)
        shown: Document = msgspec.to_builtins(details)
        errors: dict[str, str] = {}
        if request.method == "POST":
            if not is_owner:
                raise Http404
            shown = _plain(DetailsForm.read(PublicationDetails, request.POST))
            errors = dict(_errors(shown))
            if not errors:
                _store(request, row, shown)
                return HttpResponseRedirect(request.path)
        shown["authors"] = [*shown.get("authors", ()), *({"name": ""} for _n in range(EMPTY_ROWS))]
        offered = {"license": LICENCES}
        form = DetailsForm(PublicationDetails, shown, offered=offered, is_sent=bool(errors))
        for name, text in errors.items():
            form.add_error(name, text)
        context = {"form": form, "is_owner": is_owner, "missing": labels_of(details.missing)}
        title = gettext("Publication details")
        return self.study_page(request, row, "publication", title, context, tab="export")


def _store(request: HttpRequest, row: Study, details: Document) -> None:
    stored = msgspec.to_builtins(msgspec.convert(details, PublicationDetails))
    Study.objects.filter(pk=row.pk).update(publication=stored)
    text, detail = gettext("Publication details saved."), "publication details"
    note_change(request, row, "Publication details.", text, detail=detail)


def _plain(details: Document) -> Document:
    """Return details without empty authors, and without the addresses around identifiers."""
    authors = [
        {**author, "orcid": publication.plain_orcid(author.get("orcid", ""))}
        for author in details.get("authors", ())
        if any(author.values())
    ]
    keywords = list(dict.fromkeys(details.get("keywords", ())))
    doi = publication.plain_doi(details.get("doi", ""))
    return {**details, "authors": authors, "doi": doi, "keywords": keywords}


def _errors(details: Document) -> Iterator[tuple[str, str]]:
    for n, author in enumerate(details["authors"]):
        if not author.get("name"):
            yield f"authors.{n}.name", gettext("Enter the name of this author.")
        if author["orcid"] and not publication.is_orcid(author["orcid"]):
            yield f"authors.{n}.orcid", NO_ORCID % {"text": author["orcid"]}
    if details["doi"] and not publication.is_doi(details["doi"]):
        yield "doi", NO_DOI % {"text": details["doi"]}
    address = details.get("preregistration", "")
    if address and not publication.is_address(address):
        yield "preregistration", gettext("Enter an address that begins with https:// or http://.")
    if details.get("license", "") not in {"", *LICENCES}:
        yield "license", gettext("Choose one of the licences.")
