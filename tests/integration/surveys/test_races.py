"""Two people at once: both write, import, save or answer, and neither loses anything unseen."""

import itertools

import msgspec
import pytest
from django.core.files.uploadedfile import SimpleUploadedFile
from django.urls import reverse
from django.utils import timezone

from surveys.documents import BadDefinitionError, ChangedMeanwhileError
from surveys.importing.report import ImportReport
from surveys.models import Answer, Questionnaire, Response
from surveys.questionnaires import begin_empty, freeze, save_draft, store, store_next
from tests.support.browsers.html_page import read
from tests.support.people import person
from tests.support.sessions.database_race import just_before
from tests.support.studies.questionnaires import NOW, defined, item
from tests.support.studies.study_pages import form_of
from tests.support.studies.survey_files import field, redcap

pytestmark = pytest.mark.django_db
# Rows are written inside of a savepoint of their own, which a rival's row must not be part of.
WRITE = "SAVEPOINT"
REPORT = ImportReport("Qualtrics (.qsf)")


def also_imported():
    """Return a change that stores another next version of the questionnaire each time."""
    numbers = itertools.count(1)

    def change() -> None:
        mine = defined([item("text", f"theirs_{next(numbers)}")])
        newest = Questionnaire.objects.filter(slug=mine.slug).order_by("-version").first()
        store(msgspec.structs.replace(mine, version=newest.version + 1 if newest else 1), NOW)

    return change


def test_of_two_imports_under_one_name_both_are_stored():
    with just_before(WRITE, also_imported()):
        row, is_new = store_next(defined([item("text", "mine")]), REPORT, NOW)
    assert (row.version, is_new) == (2, True)
    rows = Questionnaire.objects.order_by("version")
    keys = [one.key for row in rows for one in row.as_definition().questions()]
    assert keys == ["theirs_1", "mine"]


def test_an_import_that_others_always_overtake_asks_to_try_again(client):
    client.force_login(person("boss", is_staff=True, is_superuser=True))
    file = SimpleUploadedFile("survey.csv", redcap(field("mine", "text")))
    chosen = {"file": file, "language": "en"}
    shown = client.post(reverse("admin:surveys_questionnaire_import"), chosen)
    sent = form_of(shown) | {"name": "test"}
    save = reverse("admin:surveys_questionnaire_import_save")
    with just_before(WRITE, also_imported(), times=5):
        page = read(client.post(save, sent))
    assert "Someone else is changing test. Try again." in page.text
    assert "Text of mine" in page.text
    client.post(save, sent)
    newest = Questionnaire.objects.order_by("-version").first()
    assert [newest.version, *(one.key for one in newest.as_definition().questions())] == [6, "mine"]


def test_an_import_that_is_wrong_is_refused():
    empty = msgspec.structs.replace(defined([item("text", "a")]), pages=())
    with pytest.raises(BadDefinitionError, match="no page"):
        store_next(empty, REPORT, NOW)
    assert not Questionnaire.objects.exists()


def test_a_second_questionnaire_of_the_same_name_is_refused():
    def begin() -> Questionnaire:
        return begin_empty("doors", "The doors", ["en"], NOW)

    with (
        just_before(WRITE, begin),
        pytest.raises(BadDefinitionError, match="already a questionnaire"),
    ):
        begin()
    assert Questionnaire.objects.count() == 1


@pytest.mark.parametrize("use", [True, False])
def test_a_draft_that_was_changed_or_put_to_use_since_it_was_read_is_not_saved(use):
    row = store(defined([item("text", "a")]), NOW)
    if use:
        freeze(row, NOW)
    else:
        save_draft(row, defined([item("text", "theirs")]))
    with pytest.raises(ChangedMeanwhileError):
        save_draft(row, defined([item("text", "mine")]))
    (question,) = Questionnaire.objects.get().as_definition().questions()
    assert question.key == ("a" if use else "theirs")


def test_of_two_editors_who_save_at_the_same_moment_the_second_keeps_what_was_typed(client):
    client.force_login(person("boss", is_staff=True, is_superuser=True))
    row = store(defined([item("text", "a")]), NOW)
    page = reverse("admin:surveys_questionnaire_part", args=[row.pk, "questions", "a"])
    sent = dict(form_of(client.get(page)).lists()) | {"text.en": "Mine", "do": "save"}
    theirs = defined([item("text", "a", text={"en": "Theirs"})])
    with just_before('UPDATE "surveys_questionnaire"', lambda: save_draft(row, theirs)):
        answer = client.post(page, sent)
    assert answer.status_code == 422
    assert "someone else changed this draft" in read(answer).text
    assert "Mine" in answer.content.decode()
    (question,) = Questionnaire.objects.get().as_definition().questions()
    assert question.text == {"en": "Theirs"}


# --- one respondent in two tabs -------------------------------------------------------------------


def finish_elsewhere() -> None:
    Response.objects.update(finished_at=timezone.now())


def test_of_two_tabs_that_answer_first_at_the_same_moment_the_later_answer_is_kept(take):
    ada = take([item("single", "a")])
    with just_before(WRITE, lambda: ada.save("a", "b")):
        assert ada.save("a", "c").status_code == 200
    assert Answer.objects.count() == 1
    assert ada.stored() == {"a": "c"}


def test_an_answer_to_a_response_that_is_finished_is_refused(take):
    ada = take([item("text", "a")])
    finish_elsewhere()
    answer = ada.save("a", "Late")
    assert answer.status_code == 409
    assert "already closed" in answer.json()["error"]
    assert ada.stored() == {}


def test_a_response_that_is_finished_leads_away_from_its_pages(take):
    ada = take([item("text", "a")])
    finish_elsewhere()
    assert ada.get().headers["Location"] == "/about/"
    assert ada.send(1, "a", a="Late").headers["Location"] == "/about/"
    assert ada.stored() == {}


def test_choices_are_kept_when_the_page_is_shown_again(take):
    ada = take([item("multiple", "a"), item("text", "b")])
    ada.save("a", ["b", "d"])
    boxes = [one for one in read(ada.get(1)).all("input") if one.attributes.get("name") == "a"]
    assert [one.attributes["value"] for one in boxes if "checked" in one.attributes] == ["b", "d"]
