"""The publication details of a study: written by owners, also after it was published, and shown by
every export.
"""

import io
import json

import pytest
from django.core.management import call_command
from django.urls import reverse

from experiments import publishing
from experiments.definition.publication import from_stored
from experiments.models import Study
from tests.integration.experiments.test_publishing import NOW
from tests.support.browsers.html_page import read
from tests.support.people import person
from tests.support.studies.members import signed_in
from tests.support.studies.studies import small_study

pytestmark = pytest.mark.django_db
FILLED = {
    "authors.0": "",
    "authors.0.name": "Carberry, Josiah",
    "authors.0.orcid": "https://orcid.org/0000-0002-1825-0097",
    "authors.0.affiliation": "Brown University",
    "authors.1": "",
    "authors.1.name": "",
    "license": "CC-BY-4.0",
    "funder": "NSF 1",
    "preregistration": "https://osf.io/abcde",
    "doi": "https://doi.org/10.5281/zenodo.1234567",
    "keywords": "robots, telepresence, robots",
    "ethics": "CEUMA 1",
}


@pytest.fixture
def study():
    row = publishing.store(small_study(), NOW)
    Study.objects.filter(pk=row.pk).update(status=Study.Status.PUBLISHED)
    return row


@pytest.fixture
def page(client, study):
    signed_in(client, "owner", study.slug)
    return reverse("admin:experiments_study_publication", args=[study.pk])


def kept(study):
    return from_stored(Study.objects.get(pk=study.pk).publication)


def test_publication_details_of_an_owner_are_in_the_export(client, study, page, tmp_path):
    assert client.post(page, FILLED).status_code == 302
    assert kept(study).keywords == ("robots", "telepresence")
    assert kept(study).doi == "10.5281/zenodo.1234567"
    assert 'value="Carberry, Josiah"' in client.get(page).content.decode()
    shown = io.StringIO()
    call_command("export_study", study.slug, out=tmp_path / "e", stdout=io.StringIO(), stderr=shown)
    assert shown.getvalue() == ""
    book = json.loads((tmp_path / "e" / "dataset_description.json").read_text())
    assert book["author"][0]["identifier"] == "https://orcid.org/0000-0002-1825-0097"
    assert publishing.new_version(Study.objects.get(pk=study.pk), NOW).publication["license"]


@pytest.mark.parametrize(
    ("field", "value", "problem"),
    [
        ("authors.0.orcid", "0000-0002-1825-0098", "check digit"),
        ("authors.0.name", "", "Enter the name of this author."),
        ("doi", "zenodo.12", "is not a DOI"),
        ("preregistration", "osf.io/abcde", "Enter an address"),
        ("license", "WTFPL", "Choose one of the licences."),
    ],
)
def test_an_error_is_shown_at_its_field_and_nothing_is_stored(
    client, study, page, field, value, problem
):
    shown = read(client.post(page, FILLED | {field: value}))
    assert problem in shown.text
    assert kept(study).authors == ()


def test_an_export_lists_missing_publication_details(client, study, page, tmp_path):
    shown = io.StringIO()
    call_command("export_study", study.slug, out=tmp_path / "e", stdout=io.StringIO(), stderr=shown)
    assert "authors, license, funder" in shown.getvalue()
    assert "Not filled in by its owners: authors" in (tmp_path / "e" / "README.md").read_text()
    shown = client.get(reverse("analysis_export", args=[study.slug])).content.decode()
    assert "Licence" in shown
    assert page in shown


def test_viewers_see_publication_details_and_cannot_change_them(client, study, page):
    signed_in(client, "viewer", study.slug, "vera")
    assert client.get(page).status_code == 200
    assert client.post(page, FILLED).status_code == 404
    client.force_login(person("otto", is_staff=True))
    assert client.get(page).status_code == 404
