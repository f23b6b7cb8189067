"""No stored text becomes markup on any page."""

from html.parser import HTMLParser
from typing import Any, NoReturn

import pytest
from django.apps import apps
from django.db import models, transaction
from django.test import Client
from django.urls import get_resolver
from django.utils.html import escape

from sessions.models import Session, SessionEvent
from tests.integration.site.web.test_roles import Reached, address, names, table, world

pytestmark = pytest.mark.django_db
# The least number of pages that show one of the texts.
SHOWN = {"administrator": 60, "study_owner": 30, "robot_owner": 20, "participant": 6}
# Ends an attribute of either quote, a script and a text area.
PAYLOAD = "'\"></script></textarea><img src=x>"
# Fields with texts of people, robots and other programs. Other fields have fixed values or keys.
FIELDS = {
    *("comment", "context_label", "description", "detail", "deviations", "display_name", "email"),
    *("excluded_reason", "first_name", "guardian", "held", "host", "label", "outcome_reason"),
    *("reason", "text", "thing", "title", "turnaround_reason", "unrehearsed_reason"),
}
LANGUAGES_AND_TEXTS = {*("en", "es"), *("title", "label", "comment", "text")}


class Images(HTMLParser):
    """Finds the image of the payload."""

    found = False

    def handle_starttag(self, tag, attrs):
        self.found |= tag == "img" and ("src", "x") in attrs


def is_markup(page: str) -> bool:
    reader = Images()
    reader.feed(page)
    return reader.found


def poison() -> int:
    """Put the payload into every text; return the number of fields and documents."""
    count = 0
    for model in apps.get_models():
        for field in model._meta.fields:
            if field.name in FIELDS:
                count += model._base_manager.update(**{field.name: PAYLOAD}) > 0
            elif isinstance(field, models.JSONField):
                count += poison_documents(model, field.name)
    return count


def poison_documents(model: type[models.Model], name: str) -> int:
    count = 0
    for row in model._base_manager.all():
        document = getattr(row, name)
        changed = with_payload(document)
        if changed != document:
            model._base_manager.filter(pk=row.pk).update(**{name: changed})
            count += 1
    return count


def with_payload(part: Any) -> Any:
    """Return a document with the payload for its texts; names in it stay."""
    if isinstance(part, list):
        return [with_payload(one) for one in part]
    if not isinstance(part, dict):
        return part
    return {
        key: PAYLOAD
        if isinstance(value, str) and key in LANGUAGES_AND_TEXTS
        else with_payload(value)
        for key, value in part.items()
    }


@pytest.mark.parametrize(
    "page", ['<p title="%s">', "<p title='%s'>", "<p>%s", "<script>%s", "<textarea>%s"]
)
def test_payload_is_found_where_it_is_markup(page):
    assert is_markup(page % PAYLOAD)
    assert not is_markup(page % escape(PAYLOAD))


@pytest.mark.parametrize("role", ["administrator", "study_owner", "robot_owner", "participant"])
def test_no_stored_text_becomes_markup(role, world, monkeypatch):
    def reached(*_args: Any) -> NoReturn:
        raise Reached

    for module in ("analysis_views", "analysis_downloads"):
        monkeypatch.setattr(f"experiments.research.{module}.asked_of", reached)
    add_events(world["session"])
    assert poison() > 20
    client, known = Client(), names(get_resolver())
    client.force_login(world["people"][role])
    pages = {
        name: page_of(client, address(name, args, world))
        for name, args, _allowed, posted in [*table(), ("home", [], None, None)]
        if name.partition("?")[0] in known and posted is None
    }
    assert [name for name, page in pages.items() if is_markup(page)] == []
    assert sum("img src=x" in page for page in pages.values()) >= SHOWN[role]


def add_events(session: Session) -> None:
    """Record texts of a drive."""
    for source, kind in (("page", "chat"), ("robot", "warning"), ("page", "client_error")):
        times = dict.fromkeys(("stamp", "received_at"), session.driving_at.timestamp())
        data = dict.fromkeys(("text", "reason", "message"), PAYLOAD)
        SessionEvent.objects.create(session=session, source=source, type=kind, data=data, **times)


def page_of(client: Client, url: str) -> str:
    """Return a page, empty for other answers and for pages that take too long."""
    try:
        with transaction.atomic():
            answer = client.get(url)
            transaction.set_rollback(True)
    except Reached:
        return ""
    is_page = not answer.streaming and answer["Content-Type"].startswith("text/html")
    return answer.content.decode() if is_page else ""
