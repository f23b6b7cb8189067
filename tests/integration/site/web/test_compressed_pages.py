"""Visitors' pages go out compressed; pages that show secrets do not."""

import gzip

import pytest
from django.urls import reverse

from accounts.models import User
from robots.models import Robot
from tests.support.people import person

pytestmark = pytest.mark.django_db
BROWSER = {"Accept-Encoding": "gzip, deflate, br"}


@pytest.mark.parametrize("address", ["/", "/about/", "/robots/giraff/"])
def test_visitors_page_is_compressed_if_the_browser_supports_it(client, address):
    Robot.objects.create(name="giraff", title="Giraff")
    client.force_login(person("ada"))
    plain = client.get(address)
    packed = client.get(address, headers=BROWSER)
    assert "Content-Encoding" not in plain.headers
    assert packed.headers["Content-Encoding"] == "gzip"
    assert len(packed.content) < len(plain.content) / 2
    assert "Accept-Encoding" in packed.headers["Vary"]
    assert b"</html>" in gzip.decompress(packed.content)


def test_administration_and_answers_to_forms_are_not_compressed(client):
    client.force_login(User.objects.create_superuser("root", password="x"))
    page = client.get(reverse("admin:robots_robot_changelist"), headers=BROWSER)
    assert page.status_code == 200
    assert "Content-Encoding" not in page.headers
    client.logout()
    refused = client.post(
        reverse("account_login"), {"login": "x", "password": "y"}, headers=BROWSER
    )
    assert b"csrfmiddlewaretoken" in refused.content
    assert "Content-Encoding" not in refused.headers
