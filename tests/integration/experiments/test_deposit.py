"""A study's dataset in a repository: as a draft, compared, sent once, and with a reason where it
cannot be. The repositories are doubles (tests/support/programs/repository_doubles.py).
"""

import io
import json
import zipfile
from hashlib import md5

import msgspec
import pytest
from asgiref.sync import sync_to_async
from django.core.management import CommandError, call_command
from django.test import AsyncClient
from django.urls import reverse

from accounts.models import AuditEntry
from experiments import publishing
from experiments.definition.publication import Author, PublicationDetails
from experiments.models import Study, StudyMember
from tests.integration.experiments.test_publishing import NOW
from tests.support.people import person
from tests.support.programs.repository_doubles import (
    GOOD,
    READ_ONLY,
    OsfDouble,
    ZenodoDouble,
    running,
)
from tests.support.studies.members import member
from tests.support.studies.studies import small_study

pytestmark = pytest.mark.django_db
DETAILS = PublicationDetails(
    authors=(Author(name="Carberry, Josiah", orcid="0000-0002-1825-0097"),),
    license="CC-BY-4.0",
    preregistration="https://osf.io/abcde",
    keywords=("robots",),
    ethics="CEUMA 1",
)
DOUBLES = {"zenodo": ZenodoDouble, "osf": OsfDouble}


@pytest.fixture
def study():
    row = publishing.store(small_study(), NOW)
    Study.objects.filter(pk=row.pk).update(publication=msgspec.to_builtins(DETAILS))
    return row


@pytest.fixture(params=DOUBLES)
def place(request, monkeypatch):
    """A repository: its name, what it holds and its address; the token is good."""
    monkeypatch.setenv("ZENODO_TOKEN", GOOD)
    monkeypatch.setenv("OSF_TOKEN", GOOD)
    with running(DOUBLES[request.param]) as (shelf, address):
        yield request.param, shelf, address


def deposited(study, place, **options) -> str:
    output = io.StringIO()
    call_command("deposit", study.slug, to=place[0], url=place[2], stdout=output, **options)
    return output.getvalue()


def refusal(study, place, **options) -> str:
    with pytest.raises(CommandError) as caught:
        deposited(study, place, **options)
    assert GOOD not in str(caught.value)
    return str(caught.value)


def test_second_deposit_reuses_the_draft_and_sends_only_changed_files(study, place):
    name, shelf, _ = place
    archive = f"{study.slug}-{study.version}.zip"
    output = deposited(study, place)
    assert "Not published" in output
    ((draft, files),) = shelf.files.items()
    assert set(files) == {"README.md", "dataset_description.json", "SHA256SUMS", archive}
    with zipfile.ZipFile(io.BytesIO(files[archive])) as found:
        assert found.testzip() is None
        assert found.read("README.md") == files["README.md"]
    assert not any("publish" in path for _method, path in shelf.requests)
    assert AuditEntry.objects.filter(act="study_deposited", study=study.slug).exists()
    assert GOOD not in json.dumps(Study.objects.get(pk=study.pk).deposits) + output

    sent, before = len(shelf.uploads), md5(files[archive]).hexdigest()
    again = deposited(study, place)
    assert again.count("already there") == 4
    assert len(shelf.uploads) == sent
    assert list(shelf.files) == [draft]

    changed = msgspec.to_builtins(msgspec.structs.replace(DETAILS, funder="NSF 1"))
    Study.objects.filter(pk=study.pk).update(publication=changed)
    assert "dataset_description.json: replaced and compared" in deposited(study, place)
    assert md5(files[archive]).hexdigest() != before
    about = shelf.drafts[draft]
    assert "NSF 1" in json.dumps(about)
    if name == "zenodo":
        assert about["metadata"]["creators"][0]["orcid"] == "0000-0002-1825-0097"
        assert about["metadata"]["license"] == "cc-by-4.0"
        assert about["submitted"] is False
    else:
        assert about["public"] is False


def test_interrupted_deposit_is_resumed(study, place):
    _, shelf, _ = place
    shelf.hangs_up_at = f"{study.slug}-{study.version}.zip"
    assert "was lost" in refusal(study, place)
    ((_, files),) = shelf.files.items()
    there = set(files)
    assert there == {"README.md", "dataset_description.json", "SHA256SUMS"}
    shelf.hangs_up_at = ""
    assert deposited(study, place).count("already there") == len(there)
    assert len(files) == len(there) + 1
    assert len(shelf.files) == 1


def test_each_refusal_has_an_instruction(study, place, monkeypatch):
    name, shelf, _ = place
    variable = f"{name.upper()}_TOKEN"
    monkeypatch.setenv(variable, "wrong-token")
    assert "does not accept the token" in refusal(study, place)
    monkeypatch.setenv(variable, READ_ONLY)
    assert "Make one with the scope" in refusal(study, place)
    monkeypatch.delenv(variable)
    assert f"Set {variable}" in refusal(study, place)
    assert shelf.drafts == {}
    monkeypatch.setenv(variable, GOOD)
    shelf.quota = 2000
    assert "not enough space" in refusal(study, place)
    shelf.quota, shelf.garbles = 10**9, f"{study.slug}-{study.version}.zip"
    assert "a different checksum" in refusal(study, place)
    shelf.garbles = ""
    assert "replaced and compared" in deposited(study, place)
    assert "lost" in refusal(study, (name, shelf, "http://127.0.0.1:9/api"))


def test_token_is_sent_neither_to_a_redirection_nor_unencrypted(study, place):
    name, shelf, _ = place
    shelf.redirects = True
    assert "302" in refusal(study, place)
    assert {path for _method, path in shelf.requests} == {shelf.requests[0][1]}
    assert "over HTTPS" in refusal(study, (name, shelf, "http://zenodo.example/api"))


def test_deleted_draft_is_replaced_and_published_one_is_not_changed(study, place):
    _, shelf, _ = place
    deposited(study, place)
    shelf.drafts.clear()
    owner = person("olga")
    assert "was deleted. Making a new one" in deposited(study, place, by=str(owner.pk))
    entries = AuditEntry.objects.filter(act="study_deposited", study=study.slug)
    assert {entry.actor for entry in entries} == {None, owner.pk}
    for about in shelf.drafts.values():
        about |= {"submitted": True, "public": True}
    assert "Use --new" in refusal(study, place)


@pytest.mark.parametrize("place", ["zenodo"], indirect=True)
def test_metadata_that_zenodo_would_refuse_are_refused_before_sending(study, place):
    Study.objects.filter(pk=study.pk).update(publication={})
    assert "at least one author" in refusal(study, place)
    assert place[1].requests == []
    stored = msgspec.to_builtins(msgspec.structs.replace(DETAILS, license="ODC-By-1.0"))
    Study.objects.filter(pk=study.pk).update(publication=stored)
    assert "metadata.license: Invalid license provided" in refusal(study, place)


@pytest.mark.django_db(transaction=True)
async def test_page_shows_the_output_of_the_upload(study):
    owner = await sync_to_async(person)("olga")
    await StudyMember.objects.acreate(slug=study.slug, user=owner, role="owner")
    client = AsyncClient()
    await client.aforce_login(owner)
    action = reverse("analysis_deposit", args=[study.slug])
    answer = await client.post(action, {"to": "zenodo", "token": "  "})
    assert answer["Content-Type"].startswith("text/plain")
    output = b"".join([part async for part in answer.streaming_content]).decode()
    assert "Set ZENODO_TOKEN to a token of Zenodo" in output


def test_the_export_page_offers_it_to_owners_alone(client, study):
    page = reverse("analysis_export", args=[study.slug])
    action = reverse("analysis_deposit", args=[study.slug])
    for role, status in (("researcher", 404), ("owner", 404)):
        client.force_login(member(role, study.slug))
        shown = client.get(page).content.decode()
        assert (action in shown) is (role == "owner")
        assert client.post(action, {"to": "nowhere", "token": "x"}).status_code == status
        assert client.get(action).status_code == 405
