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
from surveys.responses import Context, Respondent, Saving, finish, save_page
from tests.support.browsers.html_page import faults, read
from tests.support.people import person
from tests.support.studies.questionnaires import NOW, as_bytes, defined, document, item
from tests.support.studies.responses import begun

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


def one(*items: dict, **more) -> dict:
    """The form that sends the text of a questionnaire of one page."""
    return {"document": json.dumps(document([*items], **more))}


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
    broken = one(item("likert", "a", scale="b"), item("likert", "c", scale="<script>"))
    page = read(client.post(reverse(ADD), broken))
    messages = [e.text for e in page.all("li") if "Choose a scale" in e.text]
    assert messages == ["a: scale b: Choose a scale.", "c: scale <script>: Choose a scale."]


def test_an_import_never_replaces_a_version_that_is_here_already(client, researcher):
    store(defined([item("text", "a")]), NOW)
    answer = client.post(reverse(ADD), one(item("text", "b")))
    assert "already exists" in read(answer).text


def test_a_draft_is_changed_in_its_place(client, researcher):
    row = store(defined([item("text", "a")]), NOW)
    address = page_of("change", row)
    assert '"format": 1' in client.get(address).content.decode().replace("&quot;", '"')
    assert client.post(address, one(item("text", "b"))).status_code == 302
    (question,) = Questionnaire.objects.get().as_definition().questions()
    assert question.key == "b"
    other = client.post(address, one(item("text", "b"), version=2))
    assert "Its name and version can't change" in read(other).text


def test_a_questionnaire_in_use_is_shown_and_not_changed(client, researcher):
    row = freeze(store(defined([item("text", "a")]), NOW), NOW)
    address = page_of("change", row)
    page = client.get(address)
    assert read(page).all("textarea") == []
    assert client.post(address, one(item("text", "b"))).status_code == 403
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
    begun(row)
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
    odd = {"page": "x", "seed": "-3", "language": "xx"}
    assert client.get(page_of("preview", row), odd).status_code == 200
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
    context = Context(key="c", label="Step 3", robot=("giraff",))
    row = begun(questionnaire, Respondent(user=person("ada")), context)
    answer(row, a=["b"], m=["a", "c"], o=["1.c", "3.a", "2.b"], t=["=1+1"])
    return row


def answer(row: Response, **fields: list[str]) -> None:
    """Send the first page with these answers."""
    definition, saving = row.questionnaire.as_definition(), Saving(now=NOW, language="en")
    save_page(row, definition, 0, fields=fields, offered=list(fields), saving=saving)


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
    definition = answered.questionnaire.as_definition()
    assert lines[0]["text_version"] == definition.question("a").fingerprint("en")
    finish(answered, definition, NOW)
    lines = table(client.get(page_of("answers", answered.questionnaire, "long")))
    assert [line["missing"] for line in lines] == ["", "", "", "", "not_asked", "skipped"]


@pytest.mark.parametrize("layout", ["long", "wide"])
def test_formulas_inside_an_answer_are_escaped(client, researcher, answered, layout):
    answer(answered, t=["fine\r=HYPERLINK(A1);=2\t-x"])
    file = body(client.get(page_of("answers", answered.questionnaire, layout)))
    assert "fine\n'=HYPERLINK(A1);'=2\t'-x" in file


def test_the_wide_table_has_a_line_a_response_of_any_version(client, researcher, answered):
    second = store(defined([item("single", "a"), item("number", "n")], version=2), NOW)
    begun(second, now=NOW + datetime.timedelta(hours=1))
    first, other = table(client.get(page_of("answers", second, "wide")))
    assert [first[name] for name in ("o.a", "o.b", "o.c", "o_missing")] == ["3", "2", "1", ""]
    assert [other[name] for name in ("o.a", "o.b", "o.c", "o_missing")] == [""] * 4
    filled = {"version": "1", "a": "b", "m": "a|c", "n": "", "n_missing": ""}
    assert first | filled == first
    unreached = {"a_missing": "not_reached", "n_missing": "not_reached", "m_missing": ""}
    assert other | unreached | {"version": "2", "respondent": "anna"} == other


def test_the_wide_table_holds_the_scores(client, researcher):
    row = begun(current("sus", NOW))
    answer(row, **{f"sus{n}": ["3"] for n in range(1, 11)})
    (line,) = table(client.get(page_of("answers", row.questionnaire, "wide")))
    assert line["sus"] == "50.0"


def test_a_table_costs_the_same_number_of_queries_for_many_responses(
    client, researcher, django_assert_max_num_queries
):
    questionnaire = store(defined([item("text", "a")]), NOW)
    for n in range(30):
        begun(questionnaire, Respondent(key=f"r{n}"))
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
    chosen = {"action": "download_answers", "_selected_action": [str(answered.pk)]}
    file = client.post(reverse("admin:surveys_response_changelist"), chosen)
    assert len(table(file)) == 6


def test_answers_are_never_edited_but_a_response_can_be_deleted(client, researcher, answered):
    address = reverse("admin:surveys_response_change", args=[answered.pk])
    assert client.post(address, {"outcome": "forged"}).status_code == 403
    delete = reverse("admin:surveys_response_delete", args=[answered.pk])
    assert client.post(delete, {"post": "yes"}).status_code == 302
    assert not Response.objects.exists()
    assert not Answer.objects.exists()


def test_permission_to_see_questionnaires_does_not_show_answers(client, answered):
    row = answered.questionnaire
    staff_with(client, "view_questionnaire")
    assert client.get(page_of("preview", row)).status_code == 200
    assert client.get(page_of("export", row)).status_code == 200
    assert client.get(page_of("answers", row, "long")).status_code == 403
    response = reverse("admin:surveys_response_change", args=[answered.pk])
    assert client.get(response).status_code == 403
    assert client.post(page_of("new_version", row)).status_code == 403
    assert client.post(reverse("admin:surveys_questionnaire_shipped")).status_code == 403
    client.force_login(answered.user)
    for name in ("preview", "export"):
        assert client.get(page_of(name, row)).status_code == 302


def test_lists_refuse_lookups_of_columns_that_they_do_not_show(client, answered):
    staff_with(client, "view_questionnaire", "view_response")
    responses = reverse("admin:surveys_response_changelist")
    for page, lookup in (
        (reverse(LIST), "responses"),
        (reverse(LIST), "sha256__startswith"),
        (responses, "slot__startswith"),
        (responses, "user"),
    ):
        assert client.get(page, {lookup: str(answered.pk)}).status_code == 400, lookup
    link = f"?questionnaire__id__exact={answered.questionnaire_id}"
    assert link in client.get(reverse(LIST)).content.decode()
    assert client.get(responses + link).context["cl"].result_count == 1
