"""Questionnaires from other systems: the administration's two pages, the command, versions."""

import functools
import re
import time
from io import StringIO
from pathlib import Path

import pytest
from django.contrib.auth.models import Permission
from django.core.files.uploadedfile import SimpleUploadedFile
from django.core.management import CommandError, call_command
from django.urls import reverse

from accounts.models import AuditEntry
from robots.files import limited_process
from robots.files.limited_process import ChildLimits
from surveys.models import Questionnaire
from surveys.questionnaires import freeze
from tests.support.browsers.html_page import faults, read
from tests.support.people import person
from tests.support.studies.questionnaires import NOW
from tests.support.studies.survey_files import displays, field, lime, lss, payload, qsf, redcap

pytestmark = pytest.mark.django_db
CHOOSE = "admin:surveys_questionnaire_import"
SAVE = "admin:surveys_questionnaire_import_save"

FRUIT = qsf(
    payload("Q1", "MC", "SAVR", Choices=displays("Apple", "Pear"), text="Which fruit?"),
    payload("Q2", "HeatMap", "OnOff", text="Where do you look?"),
    payload(
        "Q3",
        "Matrix",
        "Likert",
        "MultipleAnswer",
        Choices=displays("A"),
        Answers=displays("x", "y"),
    ),
    SurveyName="Fruit 2024",
)


def own_faults(page) -> list[str]:
    """Return the faults of a page that are not Django's own: its scripts, landmarks and
    headings; the button of a submit row says what it does by its value.
    """
    django = re.compile(r"h\d follows|\d h1|inline|<|None without label")
    return [fault for fault in faults(page) if not django.match(fault)]


def choose(client, content: bytes, **more: str):
    file = SimpleUploadedFile("survey.qsf", content)
    return client.post(reverse(CHOOSE), {"file": file, "language": "en", **more})


def parcel(answer) -> str:
    (found,) = [one for one in read(answer).all("input") if one.attributes.get("name") == "parcel"]
    return found.attributes["value"]


def save(client, answer, name: str = "fruit-2024"):
    return client.post(reverse(SAVE), {"parcel": parcel(answer), "name": name}, follow=True)


# --- the administration ---------------------------------------------------------------------------


def test_the_list_leads_to_the_import(client, researcher):
    page = read(client.get(reverse("admin:surveys_questionnaire_changelist")))
    assert reverse(CHOOSE) in [link.attributes.get("href") for link in page.all("a")]
    assert own_faults(read(client.get(reverse(CHOOSE)))) == []


def test_the_report_is_shown_before_anything_is_stored(client, researcher):
    answer = choose(client, FRUIT)
    page = read(answer)
    assert own_faults(page) == []
    assert "Which fruit?" in page.text
    assert "Where do you look?" in page.text
    assert "HeatMap/OnOff" in page.text
    assert "Each row becomes a separate question." in page.text
    assert "not stored yet" in page.text
    assert not Questionnaire.objects.exists()


def test_the_questionnaire_shown_is_stored_with_its_report(client, researcher):
    page = read(save(client, choose(client, FRUIT)))
    assert "version 1 of “fruit-2024”" in page.text
    row = Questionnaire.objects.get()
    assert (row.slug, row.version, row.title) == ("fruit-2024", 1, "Fruit 2024")
    assert [question.key for question in row.as_definition().questions()] == ["q1", "q3_1"]
    assert "HeatMap/OnOff" in page.text
    assert AuditEntry.objects.filter(act="questionnaire_imported").count() == 1
    preview = client.get(reverse("admin:surveys_questionnaire_preview", args=[row.pk]))
    assert "Which fruit?" in read(preview).text


def test_the_same_file_twice_is_reported_as_identical(client, researcher):
    save(client, choose(client, FRUIT))
    page = read(save(client, choose(client, FRUIT)))
    assert "is identical" in page.text
    assert Questionnaire.objects.count() == 1


def test_the_same_form_sent_twice_stores_one_version(client, researcher):
    answer = choose(client, FRUIT)
    save(client, answer)
    save(client, answer)
    assert Questionnaire.objects.count() == 1


def test_a_changed_file_is_the_next_version_and_what_is_in_use_stays(client, researcher):
    save(client, choose(client, FRUIT))
    first = freeze(Questionnaire.objects.get(), NOW)
    save(client, choose(client, FRUIT.replace(b"Apple", b"Banana")))
    rows = list(Questionnaire.objects.order_by("version"))
    assert [row.version for row in rows] == [1, 2]
    assert rows[0].sha256 == first.sha256
    assert rows[1].frozen_at is None


def test_a_name_of_another_questionnaire_makes_its_next_version(client, researcher):
    save(client, choose(client, FRUIT), name="other")
    save(client, choose(client, redcap(field("a", "text"))), name="other")
    assert [row.version for row in Questionnaire.objects.order_by("version")] == [1, 2]


def test_a_name_that_is_none_is_refused_and_the_report_is_still_there(client, researcher):
    page = read(save(client, choose(client, FRUIT), name="Not a name!"))
    assert "Which fruit?" in page.text
    assert not Questionnaire.objects.exists()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"hello", "The file has none of these formats"),
        (b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "document type"),
        (b'{"SurveyElements": ', "not valid JSON"),
        (qsf(payload("Q1", "Timing", "PageTimer")), "None of the file's questions can be imported"),
    ],
)
def test_a_file_that_cannot_be_read_is_refused_with_a_clear_message(
    client, researcher, content, message
):
    answer = choose(client, content)
    assert answer.status_code == 200
    assert message in read(answer).text


def test_a_changed_parcel_is_refused(client, researcher):
    answer = client.post(reverse(SAVE), {"parcel": "x", "name": "a"}, follow=True)
    assert "has expired" in read(answer).text
    assert not Questionnaire.objects.exists()


def test_a_form_of_a_redcap_file_in_another_language(client, researcher):
    document = redcap(field("a", "text"), field("b", "text", form="second"))
    save(client, choose(client, document, language="es", form="second"), name="second")
    definition = Questionnaire.objects.get().as_definition()
    assert definition.languages == ("es",)
    assert [question.key for question in definition.questions()] == ["b"]


def test_a_language_that_the_site_has_no_name_for_is_called_by_its_code(client, researcher):
    answer = choose(client, redcap(field("a", "text")), language="tlh")
    assert "tlh" in read(answer).text
    save(client, answer, name="klingon")
    assert Questionnaire.objects.get().as_definition().languages == ("tlh",)


def test_people_who_may_not_add_questionnaires_may_not_import(client):
    user = person("assistant", is_staff=True)
    user.user_permissions.set(Permission.objects.filter(codename="view_questionnaire"))
    client.force_login(user)
    assert client.get(reverse(CHOOSE)).status_code == 403
    assert client.post(reverse(SAVE), {"parcel": "x", "name": "a"}).status_code == 403
    listed = read(client.get(reverse("admin:surveys_questionnaire_changelist"))).text
    assert "Import from another system" not in listed


# --- the command ----------------------------------------------------------------------------------


def run(path: Path, *options: str) -> str:
    out = StringIO()
    call_command("import_questionnaire", str(path), *options, stdout=out)
    return out.getvalue()


@pytest.fixture
def survey(tmp_path) -> Path:
    path = tmp_path / "survey.lss"
    path.write_bytes(lss(lime("S", "Q1"), lime("|", "Q2")))
    return path


def test_the_command_reports_and_stores_only_when_asked_to(survey):
    output = run(survey)
    assert "imported: Q1 → q1" in output
    assert "not imported: Q2" in output
    assert "file upload" in output
    assert "Not stored" in output
    assert not Questionnaire.objects.exists()
    assert "Stored as version 1 of survey-in-en." in run(survey, "--save")
    assert "Already stored as version 1 of survey-in-en." in run(survey, "--save")
    assert "Stored as version 1 of mine." in run(survey, "--save", "--name", "mine")


def test_the_command_names_the_forms_that_were_not_chosen(tmp_path):
    path = tmp_path / "dictionary.csv"
    path.write_bytes(redcap(field("a", "text"), field("b", "text", form="second")))
    lines = run(path, "--form", "second").splitlines()
    assert lines[lines.index("imported: b → b") + 1] == "    “Text of b”"
    other = lines.index("not imported: form_one")
    assert lines[other + 1] == "    It belongs to a form that you did not choose."


@pytest.mark.parametrize(
    ("content", "message"), [(b"hello", "none of these"), (b"<document>", "not valid XML")]
)
def test_the_command_names_what_is_wrong_with_a_file(tmp_path, content, message):
    path = tmp_path / "x.lss"
    path.write_bytes(content)
    with pytest.raises(CommandError, match=message):
        run(path)


def test_the_command_names_a_file_that_is_not_there_and_a_name_that_is_none(tmp_path, survey):
    with pytest.raises(CommandError, match="No such file"):
        run(tmp_path / "nothing.qsf")
    with pytest.raises(CommandError, match="slug"):
        run(survey, "--name", "Not a name")


@pytest.mark.parametrize(
    "text",
    ["<!--" * 400_000, "&" * 900_000 + "<a " * 90_000, '<a x="' * 100_000 + ">"],
    ids=["comments", "tags", "quotes"],
)
def test_a_text_of_unclosed_markup_takes_seconds_and_not_minutes(client, researcher, text):
    hostile = qsf(payload("Q1", "MC", "SAVR", Choices=displays("A", "B"), text=text))
    before = time.monotonic()
    assert "What differs" in read(choose(client, hostile)).text
    assert time.monotonic() - before < 20.0  # the import may use 10 s


def test_a_question_of_many_choices_is_read_in_seconds(client, researcher):
    hostile = qsf(payload("Q1", "MC", "SAVR", Choices=displays(*map(str, range(60_000)))))
    assert "larger than 512 kB" in read(choose(client, hostile)).text


def test_a_file_that_takes_too_long_is_refused_with_a_sentence(client, researcher, monkeypatch):
    monkeypatch.setattr(
        limited_process, "ChildLimits", functools.partial(ChildLimits, elapsed=0.01)
    )
    assert "The file needs too much memory or time" in read(choose(client, FRUIT)).text


def test_command_prints_the_same_report(tmp_path, monkeypatch):
    (tmp_path / "fruit.qsf").write_bytes(FRUIT)
    monkeypatch.setattr(
        limited_process, "ChildLimits", functools.partial(ChildLimits, elapsed=0.01)
    )
    with pytest.raises(CommandError, match="too much memory or time"):
        call_command("import_questionnaire", tmp_path / "fruit.qsf")
