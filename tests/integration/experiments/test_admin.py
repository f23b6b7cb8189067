"""Studies in the administration: who sees them, how they come in and go out, and how they are
published.
"""

import json
import re

import msgspec
import pytest
from django.contrib.admin.models import LogEntry
from django.contrib.auth.models import Permission
from django.core.files.uploadedfile import SimpleUploadedFile
from django.urls import reverse

from experiments import publishing
from experiments.definition.schema import to_json
from experiments.definition.shipped import shipped
from experiments.models import Participant, Rehearsal, Study, StudyMember
from experiments.participation import completion
from robots.models import Robot
from surveys.models import Questionnaire
from tests.integration.experiments.test_publishing import NOW, WHY
from tests.support.browsers.html_page import faults, read
from tests.support.people import person
from tests.support.studies.members import signed_in
from tests.support.studies.studies import STUDY, small_study
from tests.support.studies.study_site import cabin_with_giraff

pytestmark = pytest.mark.django_db
LIST, ADD = "admin:experiments_study_changelist", "admin:experiments_study_add"


def at(name: str, row: Study, *args) -> str:
    return reverse(f"admin:experiments_study_{name}", args=[row.pk, *args])


def add(client, **fields):
    """Send the form that adds a study, and return the page that follows."""
    return client.post(reverse(ADD), fields, follow=True)


def document(**changes) -> str:
    """The file of the small study, with some of it replaced."""
    return json.dumps({**STUDY, **changes})


@pytest.fixture
def boss(client):
    user = person("boss", is_staff=True, is_superuser=True)
    client.force_login(user)
    return user


@pytest.fixture
def study():
    cabin_with_giraff()
    return publishing.store(small_study(), NOW)


# --- in and out -----------------------------------------------------------------------------------


def test_a_study_comes_in_as_a_file_and_goes_out_the_same(client, boss):
    content = to_json(small_study())
    answer = add(client, file=SimpleUploadedFile("s.json", content, "application/json"))
    row = Study.objects.get()
    assert answer.redirect_chain[-1][0] == at("change", row)
    assert (row.slug, row.status) == ("cabin-study", Study.Status.DRAFT)
    assert StudyMember.objects.get().user == boss
    exported = client.get(at("export", row))
    assert 'filename="cabin-study-1.json"' in exported["Content-Disposition"]
    assert exported.content == content


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("{", "not valid JSON"),
        ("[]", "Expected `object`"),
        ('{"format": 2}', "$.format"),
        (document(colour="red"), "unknown field `colour`"),
        (document(conditions=[]), "There is no condition; add at least one."),
        (
            document(courses=[{**STUDY["courses"][0], "checkpoints": []}]),
            "there is no checkpoint; add at least one.",
        ),
        (document(title={"en": "<script>", "fr": "x"}), "has a text in fr"),
        ("", "Choose a file, paste its text, or enter a name"),
    ],
)
def test_invalid_file_shows_its_problems_and_stores_nothing(client, boss, content, problem):
    assert problem in read(add(client, document=content)).text
    assert not Study.objects.exists()


def test_a_file_never_replaces_a_version_that_is_here_already(client, boss, study):
    answer = add(client, document=document(title={"en": "Hut"}))
    assert "Version 1 of cabin-study already exists" in read(answer).text
    assert Study.objects.get().title == "Cabin"


def test_name_of_a_foreign_study_is_refused(client, study):
    user = signed_in(client, "")
    user.user_permissions.set(Permission.objects.filter(codename="add_study"))
    answer = add(client, document=document(version=2))
    assert "The name cabin-study is taken" in read(answer).text
    assert Study.objects.count() == 1


def test_a_study_is_begun_empty_and_built_on(client, boss):
    page = read(add(client, name="mine", called="My study", spoken=["en", "es"]))
    assert "There is no condition; add at least one." in page.text
    assert Study.objects.get().as_definition().languages == ("en", "es")


def test_the_format_of_a_file_is_described_on_a_page_of_the_site(client, boss):
    page = read(client.get(reverse(ADD)))
    (link,) = [e.attributes["href"] for e in page.all("a") if e.text == "Format reference"]
    shown = client.get(link)
    assert shown["Content-Type"].startswith("text/html")
    assert "Content-Disposition" not in shown.headers
    assert [e.text for e in read(shown).all("h1")] == ["Studies"]


def test_a_draft_is_replaced_by_the_text_of_a_file_and_its_settings_are_kept(client, boss, study):
    changed = {"entry": "personal", "exclusive": "on", "document": document(title={"en": "Hut"})}
    assert client.post(at("change", study), changed).status_code == 302
    row = Study.objects.get()
    assert (row.title, row.entry, row.exclusive) == ("Hut", "personal", True)
    assert row.as_definition().title == {"en": "Hut"}
    wrong = client.post(at("change", study), {"entry": "open", "document": document(version=2)})
    assert "Its name and version can't change" in read(wrong).text
    assert Study.objects.get().entry == "personal"


@pytest.mark.parametrize("slug", ["exploration", "assistance"])
def test_each_shipped_study_is_added_by_one_button(client, boss, slug):
    shipping = reverse("admin:experiments_study_shipped")

    def offered() -> list[str | None]:
        return [e.attributes.get("value") for e in read(client.get(reverse(LIST))).all("button")]

    assert slug in offered()
    added = client.post(shipping, {"study": slug}, follow=True)
    assert "1 study was added" in read(added).text
    assert Study.objects.get().as_definition() == shipped()[slug]
    again = client.post(shipping, {"study": slug}, follow=True)
    assert "0 studies were added" in read(again).text
    assert slug not in offered()
    assert client.post(shipping, {"study": "nonsense"}).status_code == 404


# --- who may --------------------------------------------------------------------------------------

PAGES = ("change", "export", "publish", "members", "links", "hours")


def pages_of(row: Study) -> dict[str, str]:
    built = {
        f"{section}": at("section", row, section)
        for section in ("about", "steps", "conditions", "courses", "rules")
    }
    parts = {
        f"{section}/0": at("part", row, section, 0)
        for section in ("steps", "conditions", "courses")
    }
    return {**{name: at(name, row) for name in PAGES}, **built, **parts}


def status_by_page(client, row: Study) -> dict[str, int]:
    return {name: client.get(address).status_code for name, address in pages_of(row).items()}


def test_a_study_of_others_is_not_there_on_any_page(client, study):
    signed_in(client, "owner", slug="another")
    statuses = status_by_page(client, study)
    assert statuses.pop("change") == 302  # Django's own way to say so
    assert set(statuses.values()) == {404}
    assert "Cabin" not in client.get(reverse(LIST)).content.decode()
    posts = ("publish", "new_version", "close", "reopen", "members", "links", "hours")
    assert {client.post(at(name, study), {"reason": WHY}).status_code for name in posts} == {404}
    assert client.post(at("delete", study), {"post": "yes"}).status_code in {302, 403}
    assert Study.objects.get().status == Study.Status.DRAFT


def test_users_without_staff_status_are_sent_to_log_in(client, study):
    user = person("visitor")
    StudyMember.objects.create(slug=study.slug, user=user, role="owner")
    client.force_login(user)
    assert set(status_by_page(client, study).values()) == {302}


def test_viewers_see_a_study_and_change_nothing(client, study):
    signed_in(client, "viewer")
    statuses = status_by_page(client, study)
    assert {name for name, status in statuses.items() if status == 404} == {"publish", "links"}
    about = at("section", study, "about")
    assert read(client.get(about)).all("fieldset")[0].attributes.keys() >= {"disabled"}
    sha256 = study.sha256
    for address, fields in (
        (about, {"title.en": "Mine now", "languages": "en", "sha256": sha256}),
        (at("section", study, "steps"), {"do": "remove:0", "sha256": sha256}),
        (at("members", study), {"add": "1", "person": "rosa", "role": "owner"}),
        (at("hours", study), {"time_zone": "UTC"}),
    ):
        assert client.post(address, fields).status_code == 404
    assert client.post(at("change", study), {"entry": "personal"}).status_code == 403
    assert Study.objects.get().sha256 == sha256


def test_an_owner_without_any_permission_of_the_models_builds_and_publishes(client, study):
    signed_in(client, "owner")
    assert set(status_by_page(client, study).values()) == {200}
    assert client.post(at("publish", study), {"reason": WHY}).status_code == 302
    assert Study.objects.get().status == Study.Status.PUBLISHED


def test_the_pages_have_no_faults(client, boss, study):
    pages = pages_of(study)
    del pages["export"]
    # Django's own scripts, landmarks and headings are not ours to mend; buttons of a submit row say
    # what they do by their value.
    own = re.compile(r"h\d follows|\d h1|inline|<|(None|_\w+|make|add|exclude) without label")
    found = {
        name: [fault for fault in faults(read(client.get(address))) if not own.match(fault)]
        for name, address in pages.items()
    }
    assert {name: wrong for name, wrong in found.items() if wrong} == {}


# --- publishing -----------------------------------------------------------------------------------


def test_publishing_without_rehearsal_asks_for_a_reason_and_notes_it(client, boss, study):
    page = read(client.get(at("publish", study)))
    assert "No rehearsal of this exact definition has passed" in page.text
    refused = client.post(at("publish", study), {"reason": ""})
    assert refused.status_code == 422
    assert "No rehearsal of this definition has passed" in read(refused).text
    assert client.post(at("publish", study), {"reason": WHY}).status_code == 302
    row = Study.objects.get()
    assert (row.status, row.unrehearsed_reason) == (Study.Status.PUBLISHED, WHY)
    assert LogEntry.objects.filter(object_id=str(row.pk), change_message__contains=WHY).exists()
    assert Questionnaire.objects.get(slug="experience").frozen_at is not None


def test_a_rehearsed_study_is_published_by_a_button(client, boss, study):
    Rehearsal.objects.create(
        study=study, sha256=study.sha256, began_at=NOW, finished_at=NOW, passed=True
    )
    page = read(client.get(at("publish", study)))
    assert page.all("textarea") == []
    assert client.post(at("publish", study)).status_code == 302
    assert Study.objects.get().status == Study.Status.PUBLISHED


def test_an_impossible_study_shows_every_reason_with_the_way_to_it(client, boss):
    row = publishing.store(small_study(), NOW)
    page = read(client.get(at("change", row)))
    links = {e.text: e.attributes["href"] for e in page.all("a")}
    for problem, section, index in (
        ("Course of giraff at cabin: there is no site cabin.", "courses", 0),
        ("Condition shut: there is no robot of the series giraff.", "conditions", 1),
    ):
        assert links[problem] == at("part", row, section, index)
    refused = client.post(at("publish", row), {"reason": WHY})
    assert refused.status_code == 422
    assert read(refused).text.count("there is no site cabin.") == 1
    assert Study.objects.get().status == Study.Status.DRAFT


@pytest.fixture
def published(study):
    return publishing.publish(study, None, WHY, NOW)


def test_no_page_changes_the_definition_of_a_published_study(client, boss, published):
    fields = {"do": "remove:0", "title.en": "Hut", "languages": "en", "sha256": published.sha256}
    for name, address in pages_of(published).items():
        if name not in PAGES:
            assert client.post(address, fields).status_code == 404, name
    hut = {"entry": "personal", "document": document(title={"en": "Hut"})}
    client.post(at("change", published), hut)
    row = Study.objects.get()
    assert (row.sha256, row.title) == (published.sha256, "Cabin")
    assert "can't be changed" in read(client.get(at("section", published, "about"))).text


def test_pages_of_a_published_study_offer_nothing_that_cannot_be_done(client, boss, published):
    page = client.get(at("change", published)).content.decode()
    assert "Save and add another" not in page
    assert ">Research</a>" in page
    labels = re.findall(r">(Recruitment[^<]*|Site, [^<]*|Preregistration[^<]*|Plan)</a>", page)
    assert labels == [
        *("Site, screening and appointments", "Plan", "Preregistration and power"),
        "Recruitment and payments",
    ]
    Robot.objects.all().delete()  # a problem, if the study were a draft
    assert "to do on other pages" not in read(client.get(at("section", published, "design"))).text


def test_how_people_come_in_is_changed_after_publishing(client, boss, published):
    changed = {"entry": "personal", "exclusive": "on"}
    assert client.post(at("change", published), changed).status_code == 302
    row = Study.objects.get()
    assert (row.entry, row.exclusive, row.sha256) == ("personal", True, published.sha256)


def test_a_new_version_is_made_closed_and_opened_by_buttons(client, boss, published):
    def press(button: str) -> str:
        return read(client.post(at(button, published), follow=True)).text

    assert "Version 2 is a draft" in press("new_version")
    assert "accepts no new participants" in press("close")
    closed = Study.objects.get(version=1)
    assert (closed.status, closed.closed_at is None) == (Study.Status.CLOSED, False)
    assert "Only a published study" in press("close")
    assert "accepts participants again" in press("reopen")
    opened = Study.objects.get(version=1)
    assert (opened.status, opened.closed_at) == (Study.Status.PUBLISHED, None)
    assert "Only a closed study" in press("reopen")
    for name in ("close", "reopen", "new_version"):
        assert client.get(at(name, published)).status_code == 405


def test_only_a_draft_without_participants_is_deleted(client, boss, published):
    assert client.post(at("delete", published), {"post": "yes"}).status_code == 403
    draft = publishing.new_version(published, NOW)
    pilot = Participant.objects.create(study=draft, slot="x", created_at=NOW, seen_at=NOW)
    assert client.post(at("delete", draft), {"post": "yes"}).status_code == 403
    pilot.delete()
    assert client.post(at("delete", draft), {"post": "yes"}).status_code == 302
    assert Study.objects.get() == published


@pytest.mark.parametrize("by", ["page", "rows"])
def test_the_name_of_a_deleted_study_belongs_to_its_next_owner(client, study, by):
    second = publishing.new_version(study, NOW)
    StudyMember.objects.create(slug="another", user=signed_in(client, "owner"), role="viewer")
    client.post(at("delete", second), {"post": "yes"})
    assert StudyMember.objects.filter(slug=study.slug).count() == 1, "a version is left"
    if by == "page":
        client.post(at("delete", study), {"post": "yes"})
    else:
        Study.objects.all().delete()
    assert not Study.objects.exists()
    next_one = person("nora", is_staff=True)
    publishing.own(publishing.store(small_study(), NOW), next_one)
    assert set(StudyMember.objects.values_list("slug", "user__username", "role")) == {
        ("another", "rosa", "viewer"),
        ("cabin-study", "nora", "owner"),
    }


# --- the list and the overview --------------------------------------------------------------------


def test_the_list_tells_participants_by_kind_and_the_last_activity(client, boss, study):
    kinds = ["participant"] * 2 + ["pilot"] + ["bot"] * 3
    for n, kind in enumerate(kinds):
        Participant.objects.create(study=study, slot=str(n), kind=kind, created_at=NOW, seen_at=NOW)
    counts = {
        e.attributes["href"].split("kind__exact=")[1]: e.text
        for e in read(client.get(reverse(LIST))).all("a")
        if "kind__exact" in e.attributes["href"]
    }
    assert counts == {"participant": "2", "pilot": "1", "bot": "3"}
    assert "2026-05-04" in read(client.get(reverse(LIST))).text


def test_the_overview_gives_the_link_for_participants(client, boss, published):
    page = read(client.get(at("change", published)))
    assert "http://testserver/studies/cabin-study/" in [
        e.attributes.get("value") for e in page.all("input")
    ]


def test_researchers_see_the_codes_for_recruitment_sites(client, boss, published):
    codes = completion.codes(published)
    assert list(codes) == ["done", "timed_out", "technical_failure", "left"]
    text = read(client.get(at("change", published))).text
    assert all(code in text for code in codes.values())
    assert "turned away" not in text
    signed_in(client, "viewer")
    assert codes["done"] not in read(client.get(at("change", published))).text


def test_a_half_done_draft_of_every_kind_can_be_looked_at(client, boss):
    row = publishing.begin_empty("mine", "My study", ["en"], NOW)
    bare = msgspec.structs.replace(row.as_definition(), steps=())
    for definition in (row.as_definition(), bare):
        row = publishing.save_draft(row, definition)
        sections = ("about", "steps", "conditions", "courses", "rules")
        addresses = [at("change", row), *(at("section", row, name) for name in sections)]
        assert {client.get(address).status_code for address in addresses} == {200}
