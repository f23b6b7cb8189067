"""A respondent with a questionnaire in front of them."""

import pytest
from django.urls import reverse

from surveys.models import Answer, Response
from surveys.questionnaires import store
from surveys.responses import Context, Respondent
from tests.support.people import person
from tests.support.studies.questionnaires import NOW, defined
from tests.support.studies.responses import begun


class Taking:
    """A respondent who answers a questionnaire over HTTP."""

    def __init__(self, client, response: Response) -> None:
        self.client, self.response = client, response

    def url(self, page: int) -> str:
        return reverse("survey_page", args=[self.response.pk, page])

    def get(self, page: int | None = None):
        begin = reverse("survey", args=[self.response.pk])
        return self.client.get(self.url(page) if page else begin)

    def send(self, page: int, shown: str, **fields):
        """Send a whole page; `shown` names the questions on it."""
        return self.client.post(self.url(page), {"shown": shown.split(), **fields})

    def save(self, item: str, value="", **fields):
        """Save one answer, as the page's module does."""
        address = reverse("survey_answer", args=[self.response.pk])
        return self.client.post(address, {"item": item, item: value, **fields})

    def row(self) -> Response:
        return Response.objects.get(pk=self.response.pk)

    def stored(self) -> dict:
        """Return stored values, or reasons in brackets."""
        rows = Answer.objects.filter(response=self.response)
        return {row.item: f"({row.missing})" if row.missing else row.value for row in rows}


@pytest.fixture
def researcher(client):
    """An administrator who is signed in."""
    user = person("boss", is_staff=True, is_superuser=True)
    client.force_login(user)
    return user


@pytest.fixture
def take(client):
    """Begin a questionnaire as the signed-in ada."""

    def make(*pages, context: Context | None = None, seed: int = 5, **more) -> Taking:
        user = person()
        client.force_login(user)
        drive = {"robot": ("giraff",), "outcome": "completed"}
        context = context or Context(key="study/step/session", return_to="/about/", **drive)
        questionnaire = store(defined(*pages, **more), NOW)
        return Taking(client, begun(questionnaire, Respondent(user=user), context, seed=seed))

    return make
