"""Clients over a limit get 429 and the time to wait."""

import itertools
from types import SimpleNamespace

import pytest
from django.http import HttpResponse
from django.urls import reverse

from accounts.attempts import Attempts
from accounts.rate_limits import limited
from tests.support.people import person

pytestmark = pytest.mark.django_db
NUMBERS = itertools.count()


@pytest.fixture(autouse=True)
def one_minute(monkeypatch):
    """All within one window."""
    monkeypatch.setattr("accounts.rate_limits.time", SimpleNamespace(time=lambda: 1_000_000_000.0))


def asking(rf, view, *, user=None, address="198.51.100.7", method="post"):
    request = getattr(rf, method)("/", REMOTE_ADDR=address)
    request.user = user
    return view(request)


def view_of(**options):
    return limited(Attempts(f"test-{next(NUMBERS)}", limit=2), **options)(
        lambda _request: HttpResponse("done")
    )


def test_request_beyond_the_limit_gets_the_seconds_to_wait(rf):
    view = view_of(json=True)
    answers = [asking(rf, view) for _ in range(3)]
    assert [answer.status_code for answer in answers] == [200, 200, 429]
    assert 60 <= int(answers[2]["Retry-After"]) <= 66
    assert b"too_many_attempts" in answers[2].content


def test_reading_is_counted_only_where_that_was_asked_for(rf):
    view, counted = view_of(), view_of(reading=True)
    assert [asking(rf, view, method="get").status_code for _ in range(4)] == [200] * 4
    assert [asking(rf, counted, method="get").status_code for _ in range(3)] == [200, 200, 429]


def test_a_limit_of_refusals_does_not_count_correct_requests(rf):
    codes = [200] * 5 + [403, 403] + [200]
    view = limited(Attempts(f"test-{next(NUMBERS)}", limit=2), refusals={403})(
        lambda _request: HttpResponse(status=codes.pop(0))
    )
    assert [asking(rf, view).status_code for _ in range(8)] == [200] * 5 + [403, 403, 429]


def test_visitors_behind_one_address_are_counted_each_by_themselves(rf):
    view, ada, ben = view_of(), person("ada"), person("ben")
    assert [asking(rf, view, user=ada).status_code for _ in range(3)] == [200, 200, 429]
    assert asking(rf, view, user=ben).status_code == 200


@pytest.mark.parametrize(
    ("name", "args", "limit", "data"),
    [("study_link", ["guess"], 30, None), ("agent_enrol", [], 10, {}), ("agent_renew", [], 20, {})],
)
def test_every_door_that_could_be_tried_without_end_has_a_limit(client, name, args, limit, data):
    address = reverse(name, args=args)
    codes = [
        (client.get(address) if data is None else client.post(address, data)).status_code
        for _ in range(limit + 1)
    ]
    assert 429 not in codes[:limit]
    assert codes[limit] == 429
    page = client.get(address) if data is None else client.post(address, data)
    assert 60 <= int(page["Retry-After"]) <= 66


def test_a_person_sees_a_page_and_not_a_word_of_json(client):
    for _ in range(31):
        page = client.get(reverse("study_link", args=["guess"]))
    assert "Too many attempts" in page.content.decode()
