"""Questionnaires in the administration: import, preview, versions, downloads, who may do what."""

import csv
import datetime
import io
import json

import pytest
from asgiref.sync import async_to_sync
from django.contrib.auth.models import Permission
from django.core.files.uploadedfile import SimpleUploadedFile
from django.urls import reverse

from accounts.models import User
from surveys.models import Answer, Questionnaire, Response
from surveys.questionnaires import current, freeze, store
from surveys.responses import Context, Respondent, Saving, begin, finish, save_one, save_page
from tests.support.browsers.html_page import faults, read
from tests.support.people import person
from tests.support.studies.questionnaires import NOW, as_bytes, defined, document, item

pytestmark = pytest.mark.django_db
LIST = "admin:surveys_questionnaire_changelist"
ADD = "admin:surveys_questionnaire_add"


def staff_with(client, *codenames: str) -> User:
    user = person("assistant", is_staff=True)
    user.user_permissions.set(
        Permission.objects.filter(codename__in=codenames, content_type__app_label="surveys")
    )
    client.force_login(user)
    return user


def page_of(name: str, row, *args) -> str:
    return reverse(f"admin:surveys_questionnaire_{name}", args=[row.pk, *args])


def body(answer) -> str:
    async def gathered() -> bytes:
        return b"".join([part async for part in answer.streaming_content])

    return async_to_sync(gathered)().decode()


def table(answer) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(body(answer))))


def upload(content: bytes) -> dict:
    return {"file": SimpleUploadedFile("q.json", content, "application/json")}


# --- import and export ----------------------------------------------------------------------------


def test_a_questionnaire_comes_in_as_a_file_and_goes_out_the_same(client, researcher):
    written = document([item("text", "a")])
    assert client.post(reverse(ADD), upload(as_bytes(written))).status_code == 302
    row = Questionnaire.objects.get()
    assert (row.slug, row.version, row.title, row.frozen_at) == ("test", 1, "A test", None)
    exported = client.get(page_of("export", row))
    assert 'filename="test-1.json"' in exported["Content-Disposition"]
    assert json.loads(exported.content)["pages"] == written["pages"]
    Questionnaire.objects.all().delete()
    assert client.post(reverse(ADD), {"document": exported.content.decode()}).status_code == 302
    assert Questionnaire.objects.get().sha256 == row.sha256


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"{", "not valid JSON"),
        (b"", "Choose a file"),
        (b"\xff\x00", "not valid JSON"),
        (as_bytes(document([{"kind": "nonsense"}])), "$.pages[0].items[0]"),
    ],
)
def test_a_wrong_file_is_reported_and_not_stored(client, researcher, content, message):
    answer = client.post(reverse(ADD), upload(content) if content else {})
    assert answer.status_code == 200
    assert message in read(answer).text
    assert not Questionnaire.objects.exists()


def test_an_empty_file_is_reported_at_its_field_and_not_stored(client, researcher):
    answer = client.post(reverse(ADD), upload(b""))
    assert "The submitted file is empty." in read(answer).text
    assert "Choose a file or paste its text." not in read(answer).text
    assert not Questionnaire.objects.exists()


def test_every_problem_has_a_line_of_its_own_and_is_escaped(client, researcher):
    broken = document([item("likert", "a", scale="b"), item("likert", "c", scale="<script>")])
    page = read(client.post(reverse(ADD), {"document": json.dumps(broken)}))
    messages = [e.text for e in page.all("li") if "Choose a scale" in e.text]
    assert messages == ["a: scale b: Choose a scale.", "c: scale <script>: Choose a scale."]


def test_an_import_never_replaces_a_version_that_is_here_already(client, researcher):
    store(defined([item("text", "a")]), NOW)
    answer = client.post(reverse(ADD), {"document": json.dumps(document([item("text", "b")]))})
    assert "already exists" in read(answer).text


def test_a_draft_is_changed_in_its_place(client, researcher):
    row = store(defined([item("text", "a")]), NOW)
    address = page_of("change", row)
    assert '"format": 1' in client.get(address).content.decode().replace("&quot;", '"')
    assert (
        client.post(address, {"document": json.dumps(document([item("text", "b")]))}).status_code
        == 302
    )
    assert [
        question.key for question in Questionnaire.objects.get().as_definition().questions()
    ] == ["b"]
    other = client.post(address, {"document": json.dumps(document([item("text", "b")], version=2))})
    assert "Its name and version can't change" in read(other).text


def test_a_questionnaire_in_use_is_shown_and_not_changed(client, researcher):
    row = freeze(store(defined([item("text", "a")]), NOW), NOW)
    address = page_of("change", row)
    page = client.get(address)
    assert read(page).all("textarea") == []
    assert (
        client.post(address, {"document": json.dumps(document([item("text", "b")]))}).status_code
        == 403
    )
    assert Questionnaire.objects.get().sha256 == row.sha256


def test_a_new_version_is_made_from_what_is_in_use(client, researcher):
    row = freeze(store(defined([item("text", "a")]), NOW), NOW)
    assert client.get(page_of("new_version", row)).status_code == 405
    answer = client.post(page_of("new_version", row), follow=True)
    assert "You can edit version 2" in read(answer).text
    assert Questionnaire.objects.count() == 2


def test_those_that_come_with_the_site_are_added_once(client, researcher):
    assert "+ NASA-TLX: The effort it took" in read(client.get(reverse(LIST))).text
    address = reverse("admin:surveys_questionnaire_shipped")
    one = client.post(address, {"questionnaire": "tlx"}, follow=True)
    assert "1 questionnaire was added" in read(one).text
    assert Questionnaire.objects.get().slug == "tlx"
    assert "+ NASA-TLX" not in read(one).text
    assert "7 questionnaires were added" in read(client.post(address, follow=True)).text
    assert "0 questionnaires were added" in read(client.post(address, follow=True)).text
    listed = read(client.get(reverse(LIST))).text
    assert "SUS, System Usability Scale: Using the system" in listed
    assert "template" in listed


@pytest.mark.parametrize("term", ["NASA", "tlx", "effort"])
def test_nasa_tlx_is_found_by_its_name(client, researcher, term):
    current("tlx", NOW)
    current("sus", NOW)
    listed = read(client.get(reverse(LIST), {"q": term})).text
    assert "NASA-TLX: The effort it took" in listed
    assert "System Usability" not in listed


def test_a_questionnaire_with_responses_is_not_deleted(client, researcher):
    row = store(defined([item("text", "a")]), NOW)
    begin(row, Respondent(key="anna"), Context(key="c"), language="en", seed=1, now=NOW)
    client.post(page_of("delete", row), {"post": "yes"})
    assert Questionnaire.objects.exists()


# --- preview --------------------------------------------------------------------------------------


def test_a_preview_shows_every_page_in_every_language_and_saves_nothing(client, researcher):
    row = current("experience", NOW)
    page = read(client.get(page_of("preview", row), {"language": "es"}))
    assert faults(page) == []
    assert "Hacer la foto fue fácil." in page.text
    assert not page.all("fieldset")[0].attributes.get("hidden")
    assert Questionnaire.objects.get().frozen_at is None
    assert client.get(page_of("preview", row), {"page": "2"}).status_code == 404
    assert (
        client.get(
            page_of("preview", row), {"page": "x", "seed": "-3", "language": "xx"}
        ).status_code
        == 200
    )
    assert client.post(page_of("preview", row)).status_code == 405


# --- answers --------------------------------------------------------------------------------------


@pytest.fixture
def answered():
    pages = [
        [
            item("single", "a"),
            item("multiple", "m"),
            item("ranking", "o"),
            item("text", "t"),
            item("text", "r", show_if={"robot": ["rhodon"]}),
        ],
        [item("text", "z")],
    ]
    questionnaire = store(defined(*pages), NOW)
    row = begin(
        questionnaire,
        Respondent(user=person("ada")),
        Context(key="c", label="Step 3", robot=("giraff",)),
        language="en",
        seed=1,
        now=NOW,
    )
    definition = row.questionnaire.as_definition()
    save_page(
        row,
        definition,
        0,
        fields={"a": ["b"], "m": ["a", "c"], "o": ["1.c", "3.a", "2.b"], "t": ["=1+1"]},
        offered=["a", "m", "o", "t"],
        saving=Saving(now=NOW, language="en"),
    )
    return row


def test_the_long_table_has_a_line_a_question_and_no_formula(client, researcher, answered):
    lines = table(client.get(page_of("answers", answered.questionnaire, "long")))
    assert [(line["item"], line["value"], line["missing"]) for line in lines] == [
        ("a", "b", ""),
        ("m", "a|c", ""),
        ("o", "c|b|a", ""),
        ("t", "'=1+1", ""),
        ("r", "", "not_reached"),
        ("z", "", "not_reached"),
    ]
    assert {line["respondent"] for line in lines} == {str(answered.user_id)}
    assert lines[0]["text_version"] == answered.questionnaire.as_definition().question(
        "a"
    ).fingerprint("en")
    finish(answered, answered.questionnaire.as_definition(), NOW)
    lines = table(client.get(page_of("answers", answered.questionnaire, "long")))
    assert [line["missing"] for line in lines] == ["", "", "", "", "not_asked", "skipped"]


@pytest.mark.parametrize("layout", ["long", "wide"])
def test_an_answer_is_no_formula_for_a_spreadsheet_that_splits_it(
    client, researcher, answered, layout
):
    definition = answered.questionnaire.as_definition()
    save_page(
        answered,
        definition,
        0,
        fields={"t": ["fine\r=HYPERLINK(A1);=2\t-x"]},
        offered=["t"],
        saving=Saving(now=NOW, language="en"),
    )
    file = body(client.get(page_of("answers", answered.questionnaire, layout)))
    assert "fine\n'=HYPERLINK(A1);'=2\t'-x" in file


def test_the_wide_table_has_a_line_a_response_of_any_version(client, researcher, answered):
    second = store(defined([item("single", "a"), item("number", "n")], version=2), NOW)
    begin(
        second,
        Respondent(key="anna"),
        Context(key="c"),
        language="en",
        seed=1,
        now=NOW + datetime.timedelta(hours=1),
    )
    first, other = table(client.get(page_of("answers", second, "wide")))
    assert [first[name] for name in ("o.a", "o.b", "o.c", "o_missing")] == ["3", "2", "1", ""]
    assert [other[name] for name in ("o.a", "o.b", "o.c", "o_missing")] == [""] * 4
    assert (first["version"], first["a"], first["m"], first["n"], first["n_missing"]) == (
        "1",
        "b",
        "a|c",
        "",
        "",
    )
    assert (
        other["version"],
        other["respondent"],
        other["a_missing"],
        other["n_missing"],
        other["m_missing"],
    ) == (
        "2",
        "anna",
        "not_reached",
        "not_reached",
        "",
    )


def test_the_wide_table_holds_the_scores(client, researcher):
    row = begin(
        current("sus", NOW),
        Respondent(key="anna"),
        Context(key="c"),
        language="en",
        seed=1,
        now=NOW,
    )
    for n in range(1, 11):
        save_one(
            row,
            row.questionnaire.as_definition(),
            f"sus{n}",
            {f"sus{n}": ["3"]},
            Saving(now=NOW, language="en"),
        )
    assert [
        line["sus"] for line in table(client.get(page_of("answers", row.questionnaire, "wide")))
    ] == ["50.0"]


def test_a_table_costs_the_same_number_of_queries_for_many_responses(
    client, researcher, django_assert_max_num_queries
):
    questionnaire = store(defined([item("text", "a")]), NOW)
    for n in range(30):
        begin(
            questionnaire, Respondent(key=f"r{n}"), Context(key="c"), language="en", seed=n, now=NOW
        )
    with django_assert_max_num_queries(8):
        lines = table(client.get(page_of("answers", questionnaire, "long")))
    assert len(lines) == 30


def test_a_response_shows_every_question_with_its_answer_escaped(client, researcher, answered):
    Answer.objects.filter(item="t").update(value="<b>bold</b>")
    page = client.get(reverse("admin:surveys_response_change", args=[answered.pk]))
    assert "&lt;b&gt;bold" in page.content.decode()
    text = read(page).text
    assert "not reached" in text
    assert "Step 3" in text
    assert "0 / 2" in read(client.get(reverse("admin:surveys_response_changelist"))).text


def test_chosen_responses_are_downloaded_together(client, researcher, answered):
    answer = client.post(
        reverse("admin:surveys_response_changelist"),
        {"action": "download_answers", "_selected_action": [str(answered.pk)]},
    )
    assert len(table(answer)) == 6


def test_answers_are_never_edited_but_a_response_can_be_deleted(client, researcher, answered):
    address = reverse("admin:surveys_response_change", args=[answered.pk])
    assert client.post(address, {"outcome": "forged"}).status_code == 403
    assert (
        client.post(
            reverse("admin:surveys_response_delete", args=[answered.pk]), {"post": "yes"}
        ).status_code
        == 302
    )
    assert not Response.objects.exists()
    assert not Answer.objects.exists()


def test_permission_to_see_questionnaires_does_not_show_answers(client, answered):
    row = answered.questionnaire
    staff_with(client, "view_questionnaire")
    assert client.get(page_of("preview", row)).status_code == 200
    assert client.get(page_of("export", row)).status_code == 200
    assert client.get(page_of("answers", row, "long")).status_code == 403
    assert (
        client.get(reverse("admin:surveys_response_change", args=[answered.pk])).status_code == 403
    )
    assert client.post(page_of("new_version", row)).status_code == 403
    assert client.post(reverse("admin:surveys_questionnaire_shipped")).status_code == 403
    client.force_login(answered.user)
    for name in ("preview", "export"):
        assert client.get(page_of(name, row)).status_code == 302


def test_a_list_is_not_asked_for_what_it_does_not_show(client, answered):
    staff_with(client, "view_questionnaire", "view_response")
    for page, lookups in (
        ("questionnaire", ("responses", "sha256__startswith")),
        ("response", ("slot__startswith", "user")),
    ):
        for lookup in lookups:
            assert (
                client.get(
                    reverse(f"admin:surveys_{page}_changelist"), {lookup: str(answered.pk)}
                ).status_code
                == 400
            ), lookup
    link = f"?questionnaire__id__exact={answered.questionnaire_id}"
    assert link in client.get(reverse(LIST)).content.decode()
    assert (
        client.get(reverse("admin:surveys_response_changelist") + link).context["cl"].result_count
        == 1
    )
