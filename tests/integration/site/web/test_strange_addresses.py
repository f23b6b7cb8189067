"""Hostile addresses, headers and cookies are refused without an error of the server."""

import re
import uuid

import pytest
from django.test import Client
from django.urls import URLPattern, get_resolver

from tests.support.people import person

pytestmark = pytest.mark.django_db
STRANGE = (
    *("é", "%C3%A9", "%00", "%FF", "..", "%F0%9F%A4%96", "a" * 3000, "'\"<>;"),
    *("%0d%0aX-Evil:%201", "%E2%80%AE", "x"),
)
WORDS = {
    "": STRANGE,
    "str": STRANGE,
    "uuid": (str(uuid.UUID(int=0)),),
    "int": ("9" * 30, "0"),
    "path": (*STRANGE, "a/../b"),
}
PLACE = re.compile(r"<(?:(\w+):)?(\w+)>")


def addresses(patterns, prefix=""):
    """Yield all addresses with parameters, filled with strange words."""
    for pattern in patterns:
        route = prefix + str(pattern.pattern)
        if not isinstance(pattern, URLPattern):
            yield from addresses(pattern.url_patterns, route)
        elif pattern.pattern.converters:
            yield from filled(route)


def filled(route):
    """Yield a route with a strange word for one parameter and plain ones for the others."""
    places = PLACE.findall(route)
    for at, (kind, _) in enumerate(places):
        for word in WORDS.get(kind, ("x",)):
            words = [WORDS.get(other, ("x",))[-1] for other, _ in places]
            words[at] = word
            yield "/" + PLACE.sub("{}", route).format(*words)


def answers(client, found):
    return {address: client.get(address).status_code for address in found}


@pytest.mark.nightly
@pytest.mark.parametrize("who", ["stranger", "visitor", "superuser"])
def test_strange_addresses_cause_no_server_error(who):
    client = Client(raise_request_exception=False)
    if who != "stranger":
        client.force_login(person(is_staff=who == "superuser", is_superuser=who == "superuser"))
    codes = answers(client, addresses(get_resolver().url_patterns))
    assert len(codes) > 50
    assert {address: code for address, code in codes.items() if code >= 500} == {}


@pytest.mark.urls("telepresence_site.demo.links")
@pytest.mark.parametrize("token", STRANGE)
def test_demo_link_with_a_wrong_token_is_not_found(settings, token):
    settings.DEMO_TOKEN = "right"
    assert Client(raise_request_exception=False).get(f"/demo/{token}/giraff/").status_code == 404


BEARER = ("Bearer é:é", "Bearer \x00:\x00", "Bearer x:" + "é" * 100)
HEADERS = ("é", "\xff\xfe", *BEARER, "a" * 5000, "=é; ;;==", "%00")
NAMES = (
    *("Authorization", "Cookie", "X-Forwarded-For", "Accept-Language", "Accept-Encoding"),
    *("Referer", "User-Agent", "If-None-Match", "If-Modified-Since", "Range", "Origin"),
    *("X-Requested-With", "Content-Length", "X-Forwarded-Proto"),
)
PAGES = (
    *("/", "/about/", "/accounts/login/", "/robots/giraff/screen/", "/api/v1/robots/"),
    *("/api/v1/agent/", "/metrics", "/floorplans/x.json"),
)


@pytest.mark.parametrize("name", NAMES)
def test_strange_headers_cause_no_server_error(name, settings):
    settings.TRUSTED_PROXIES = ["127.0.0.1"]
    settings.METRICS_TOKEN = "t" * 30
    client = Client(raise_request_exception=False)
    found = {
        (page, value): client.get(page, headers={name: value}).status_code
        for page in PAGES
        for value in HEADERS
    }
    assert {at: code for at, code in found.items() if code >= 500} == {}


@pytest.mark.parametrize(
    "name", ["csrftoken", "sessionid", "messages", "django_language", "screen-giraff"]
)
@pytest.mark.parametrize("value", ["é", "%C3%A9", "a" * 5000, "[1,", "\xff", "x:y:z"])
def test_strange_cookies_cause_no_server_error(name, value):
    client = Client(raise_request_exception=False)
    for page in ("/", "/accounts/login/", "/robots/giraff/screen/", "/profile/"):
        assert client.get(page, headers={"cookie": f"{name}={value}"}).status_code < 500
