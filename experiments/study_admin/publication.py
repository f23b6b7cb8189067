"""The page on which owners write what a study's dataset says about itself in a repository."""

from typing import Any

import msgspec
from django.contrib import messages
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseRedirect
from django.urls import URLPattern
from django.utils.translation import gettext
from django.utils.translation import gettext_lazy as _

from accounts import audit
from experiments import publishing
from experiments.access import may
from experiments.builder.study_page import StudyPages
from experiments.definition.publication import (
    LICENCES,
    PublicationDetails,
    from_stored,
    is_address,
    is_doi,
    is_orcid,
    plain_doi,
    plain_orcid,
)
from experiments.models import Study
from experiments.research.publication_labels import LABELS, labels_of
from experiments.research.study_access import study_for
from surveys.document_forms.guide import FormGuide
from surveys.document_forms.part_form import PartForm
from surveys.document_forms.parts import Document

EMPTY_ROWS = 3  # for more authors
NO_ORCID = _("%(text)s is not an ORCID iD: its check digit or its format is wrong.")
NO_DOI = _("%(text)s is not a DOI such as 10.5281/zenodo.1234567.")
GUIDE = FormGuide(
    labels=LABELS | {"name": _("Name"), "orcid": _("ORCID iD"), "affiliation": _("Affiliation")},
    hints={
        "authors": _(
            "In the order in which they are cited. An author without a name is removed. Save to "
            "get more rows."
        ),
        "name": _("Family name, given names"),
        "license": _("The licence under which others may use the data, as an SPDX identifier."),
        "funder": _("The organisation that funded the study, with the grant number."),
        "preregistration": _("Its address, such as https://osf.io/abcde."),
        "doi": _("The DOI of the dataset, once a repository has reserved one."),
        "keywords": _("Separated by commas."),
        "ethics": _("The committee that approved the study, with its reference."),
    },
    items={"authors": _("Author")},
    choices={},
    spaced=frozenset({"keywords"}),
)


class DetailsForm(PartForm):
    guide = GUIDE


class PublicationPages(StudyPages):
    """The page, mixed into the studies' administration."""

    def publication_urls(self) -> list[URLPattern]:
        return [self.study_path("publication/", self.publication_view, "publication")]

    def publication_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Show the details; owners change them, also after the study was published."""
        row = study_for(request, pk, "viewer")
        is_owner = may(request.user, row.slug, "owner")
        details = from_stored(row.publication)
        shown: Document = msgspec.to_builtins(details)
        wrong: dict[str, str] = {}
        if request.method == "POST":
            if not is_owner:
                raise Http404
            shown = _plain(DetailsForm.read(PublicationDetails, request.POST))
            wrong = dict(_wrong(shown))
            if not wrong:
                self._keep(request, row, shown)
                return HttpResponseRedirect(request.path)
        shown["authors"] = [*shown.get("authors", ()), *({"name": ""} for _n in range(EMPTY_ROWS))]
        offered = {"license": LICENCES}
        form = DetailsForm(PublicationDetails, shown, offered=offered, is_sent=bool(wrong))
        for name, text in wrong.items():
            form.add_error(name, text)
        missing = labels_of(details.missing)
        context = {"form": form, "is_owner": is_owner, "missing": missing}
        title = gettext("Publication details")
        return self.study_page(request, row, "publication", title, context, tab="export")

    @staticmethod
    def _keep(request: HttpRequest, row: Study, details: Document) -> None:
        stored = msgspec.to_builtins(msgspec.convert(details, PublicationDetails))
        Study.objects.filter(pk=row.pk).update(publication=stored)
        publishing.log(row, request.user, "Publication details.")
        audit.note(
            "study_changed", actor=request.user, study=row.slug, detail="publication details"
        )
        messages.success(request, gettext("Publication details saved."))


def _plain(details: Document) -> Document:
    """Return details without empty authors, and without the addresses around identifiers."""
    authors = [
        {**author, "orcid": plain_orcid(author.get("orcid", ""))}
        for author in details.get("authors", ())
        if any(author.values())
    ]
    keywords = list(dict.fromkeys(details.get("keywords", ())))
    doi = plain_doi(details.get("doi", ""))
    return {**details, "authors": authors, "doi": doi, "keywords": keywords}


def _wrong(details: Document) -> "list[tuple[str, str]]":
    found = []
    for n, author in enumerate(details["authors"]):
        if not author.get("name"):
            found.append((f"authors.{n}.name", gettext("Enter the name of this author.")))
        if author["orcid"] and not is_orcid(author["orcid"]):
            found.append((f"authors.{n}.orcid", NO_ORCID % {"text": author["orcid"]}))
    if details["doi"] and not is_doi(details["doi"]):
        found.append(("doi", NO_DOI % {"text": details["doi"]}))
    if (address := details.get("preregistration", "")) and not is_address(address):
        text = gettext("Enter an address that begins with https:// or http://.")
        found.append(("preregistration", text))
    if details.get("license", "") not in {"", *LICENCES}:
        found.append(("license", gettext("Choose one of the licences.")))
    return found
