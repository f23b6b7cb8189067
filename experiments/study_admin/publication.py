"""The page on which owners write what a study's dataset says about itself in a repository."""

from typing import Any

import msgspec
from django import forms
from django.contrib import messages
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseRedirect
from django.shortcuts import render
from django.urls import URLPattern, path
from django.utils.translation import gettext
from django.utils.translation import gettext_lazy as _
from django.views.decorators.cache import never_cache

from accounts import audit
from experiments import publishing
from experiments.access import may
from experiments.definition.publication import (
    LICENCES,
    Author,
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

EMPTY_ROWS = 3  # for more authors
MOST_AUTHORS = 100
WIDE = {"class": "vTextField"}


class AuthorForm(forms.Form):
    """One author; a row without any text is none."""

    name = forms.CharField(
        label=_("Name"),
        required=False,
        max_length=200,
        widget=forms.TextInput(attrs=WIDE | {"placeholder": _("Family name, given names")}),
    )
    orcid = forms.CharField(
        label=_("ORCID iD"),
        required=False,
        max_length=60,
        widget=forms.TextInput(attrs={"placeholder": "0000-0002-1825-0097"}),
    )
    affiliation = forms.CharField(
        label=_("Affiliation"), required=False, max_length=300, widget=forms.TextInput(attrs=WIDE)
    )

    def clean_orcid(self) -> str:
        """Read the iD, also as an address; its last character tells typing errors."""
        orcid = plain_orcid(self.cleaned_data["orcid"])
        if orcid and not is_orcid(orcid):
            raise forms.ValidationError(
                gettext("%(orcid)s is not an ORCID iD: its check digit or its format is wrong.")
                % {"orcid": orcid}
            )
        return orcid

    def clean(self) -> dict[str, Any]:
        """Ask for the name of whoever has an iD or an affiliation."""
        found = super().clean() or self.cleaned_data
        if (found.get("orcid") or found.get("affiliation")) and not found.get("name"):
            self.add_error("name", gettext("Enter the name of this author."))
        return found


AuthorForms = forms.formset_factory(
    AuthorForm, extra=EMPTY_ROWS, max_num=MOST_AUTHORS, absolute_max=MOST_AUTHORS
)


def _line(name: str, most: int, hint: Any) -> forms.CharField:
    wide = forms.TextInput(attrs=WIDE)
    return forms.CharField(
        label=LABELS[name], required=False, max_length=most, widget=wide, help_text=hint
    )


class PublicationForm(forms.Form):
    """What a dataset says about itself beside its authors."""

    license = forms.ChoiceField(
        label=LABELS["license"],
        required=False,
        choices=[("", "–"), *((name, name) for name in LICENCES)],
        help_text=_("The licence under which others may use the data, as an SPDX identifier."),
    )
    funder = _line(
        "funder", 300, _("The organisation that funded the study, with the grant number.")
    )
    preregistration = _line("preregistration", 500, _("Its address, such as https://osf.io/abcde."))
    doi = _line("doi", 200, _("The DOI of the dataset, once a repository has reserved one."))
    keywords = _line("keywords", 500, _("Separated by commas."))
    ethics = _line("ethics", 500, _("The committee that approved the study, with its reference."))

    def clean_preregistration(self) -> str:
        """Ask for an address."""
        address: str = self.cleaned_data["preregistration"].strip()
        if address and not is_address(address):
            raise forms.ValidationError(
                gettext("Enter an address that begins with https:// or http://.")
            )
        return address

    def clean_doi(self) -> str:
        """Read a DOI, also as an address."""
        doi = plain_doi(self.cleaned_data["doi"])
        if doi and not is_doi(doi):
            raise forms.ValidationError(
                gettext("%(doi)s is not a DOI such as 10.5281/zenodo.1234567.") % {"doi": doi}
            )
        return doi

    def clean_keywords(self) -> tuple[str, ...]:
        """Read keywords, each once."""
        parts = (part.strip() for part in self.cleaned_data["keywords"].split(","))
        return tuple(dict.fromkeys(filter(None, parts)))


class PublicationPages:
    """The page, mixed into the studies' administration."""

    def publication_urls(self) -> list[URLPattern]:
        """Return its address."""
        guard = self.admin_site.admin_view  # type: ignore[attr-defined]
        view = guard(never_cache(self.publication_view))
        return [path("<uuid:pk>/publication/", view, name="experiments_study_publication")]

    def publication_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Show the details; owners change them, also after the study was published."""
        row = study_for(request, pk, "viewer")
        is_owner = may(request.user, row.slug, "owner")
        details = from_stored(row.publication)
        given = request.POST if request.method == "POST" else None
        form = PublicationForm(given, initial=_initial(details))
        authors = AuthorForms(given, initial=_full(details))
        if request.method == "POST":
            if not is_owner:
                raise Http404
            if form.is_valid() and authors.is_valid():
                self._keep(request, row, _details(form, authors))
                return HttpResponseRedirect(request.path)
        around = self.admin_site.each_context(request) | {  # type: ignore[attr-defined]
            "title": gettext("Publication details"),
            "opts": self.opts,  # type: ignore[attr-defined]
            "study": row,
            "study_tab": "export",
            "form": form,
            "authors": authors,
            "is_owner": is_owner,
            "missing": labels_of(details.missing),
        }
        return render(request, "admin/experiments/study/publication.html", around)

    @staticmethod
    def _keep(request: HttpRequest, row: Study, details: PublicationDetails) -> None:
        Study.objects.filter(pk=row.pk).update(publication=msgspec.to_builtins(details))
        publishing.log(row, request.user, "Publication details.")
        audit.note(
            "study_changed", actor=request.user, study=row.slug, detail="publication details"
        )
        messages.success(request, gettext("Publication details saved."))


def _initial(details: PublicationDetails) -> dict[str, Any]:
    found = {name: getattr(details, name) for name in PublicationForm.base_fields}
    return found | {"keywords": ", ".join(details.keywords)}


def _full(details: PublicationDetails) -> list[dict[str, str]]:
    return [
        {"name": one.name, "orcid": one.orcid, "affiliation": one.affiliation}
        for one in details.authors
    ]


def _details(form: PublicationForm, authors: Any) -> PublicationDetails:
    given = [one.cleaned_data for one in authors.forms if one.cleaned_data.get("name")]
    return PublicationDetails(authors=tuple(Author(**one) for one in given), **form.cleaned_data)
