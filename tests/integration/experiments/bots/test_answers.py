import datetime

import pytest
from django.test import Client
from django.urls import reverse

from experiments.bots.answers import fill
from experiments.bots.page import HtmlPage
from experiments.bots.persona import Persona
from surveys import questionnaires, responses
from surveys.models import Response
from surveys.responses import Context, Respondent
from tests.support.people import person
from tests.support.studies.questionnaires import NOW, defined, item, rows

pytestmark = pytest.mark.django_db
EVERY_KIND = defined(
    [
        item("likert", "ease", required=True),
        item("grid", "parts", rows=rows("one", "two"), required=True),
        item("single", "which", required=True),
    ],
    [
        item("multiple", "some", required=True, at_least=1),
        item("number", "birth_year", required=True, minimum=1900, maximum="this_year", whole=True),
        item("number", "share", required=True, minimum=0.0, maximum=1.0),
        item("text", "words", required=True, lines=3),
        item("date", "day", required=True, latest="today"),
        item("slider", "effort", required=True, step=5),
        item("ranking", "order", required=True, order="shuffled"),
    ],
    [
        item("text", "more", required=True, show_if={"item": "which", "is": ["b"]}),
        item("likert", "last"),
    ],
)


def go_through(client: Client, response: Response, persona: Persona) -> int:
    """Answer page after page as a bot does, and return how many there were."""
    address, pages = reverse("survey", args=[response.pk]), 0
    while True:
        answer = client.get(address, follow=True)
        form = HtmlPage(answer.content.decode()).form("survey")
        if form is None:
            return pages
        pages += 1
        assert pages < 10
        here = answer.redirect_chain[-1][0] if answer.redirect_chain else address
        sent: dict[str, list[str]] = {}
        for name, value in [*form.hidden, *fill(form, persona, {}, NOW)]:
            sent.setdefault(name, []).append(value)
        after = client.post(here, sent)
        assert after.status_code == 302, HtmlPage(after.content.decode()).errors
        address = after.url


@pytest.mark.parametrize(
    "definition",
    [EVERY_KIND, *(one for one in questionnaires.shipped().values() if not one.template)],
    ids=lambda d: d.slug,
)
@pytest.mark.parametrize("number", range(4))
def test_a_bot_answers_every_kind_of_question_to_the_end(definition, number):
    user = person(f"bot{number}")
    client = Client()
    client.force_login(user)
    row = questionnaires.store(definition, NOW)
    context = Context(key=f"test/{number}", robot=("giraff",), outcome="completed")
    response = responses.begin(row, Respondent(user=user), context, language="en", now=NOW, seed=5)
    assert go_through(client, response, Persona(number, 3, explore=number)) >= 1
    response.refresh_from_db()
    assert response.finished_at is not None


def test_bot_gives_its_age_and_ticks_a_required_box():
    form = HtmlPage(
        '<main><form method="post"><label for="a">Your age in years</label><input type="number"'
        ' id="a" name="age" min="1" max="120"><label for="g">Guardian</label><input type="text"'
        ' id="g" name="guardian"><input type="checkbox" name="agree" id="c"></form></main>'
    ).forms[0]
    persona = Persona(1, 1)
    now = datetime.datetime(2026, 3, 1, tzinfo=datetime.UTC)
    assert fill(form, persona, {}, now) == [
        ("age", str(2026 - persona.birth_year)),
        ("agree", "on"),
    ]
