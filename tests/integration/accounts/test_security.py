"""Headers and cookies, as a browser gets them, with the settings of a public server in a process of
its own.
"""

import json
import os
import shutil
import subprocess
import sys

import pytest
from django.test import Client
from django.urls import reverse

from tests.support.collected import collected_files
from tests.support.paths import ROOT
from tests.support.people import PASSWORD, person
from tests.support.sessions.site import DATABASE, empty_database

ASK = """
import json, django
django.setup()
from django.conf import settings
from django.test import Client
from django.test.utils import setup_test_environment
from accounts.models import User
User.objects.create_user("ada", password="seven green kettles")
client = Client(headers={"host": "robots.example"})
plain = client.get("/accounts/login/")
page = client.get("/accounts/login/", secure=True)
who = {"login": "ada", "password": "seven green kettles"}
answer = client.post("/accounts/login/", who, secure=True)
cookies = {
    n: {k: m[k] for k in ("secure", "httponly", "samesite")} for n, m in client.cookies.items()
}
print(json.dumps({"plain": [plain.status_code, plain.get("location")],
                  "headers": dict(page.headers), "cookies": cookies,
                  "page": page.status_code, "answer": answer.status_code}))
"""


@pytest.fixture(scope="module")
def public_server(tmp_path_factory):
    """What a server with its defaults answers, and one name that it is known by."""
    development = {"HTTP_ONLY", "DEBUG"}
    environment = {key: value for key, value in os.environ.items() if key not in development}
    var = tmp_path_factory.mktemp("public")
    shutil.copyfile(empty_database(), var / DATABASE)
    environment |= {
        "VAR_DIR": str(var),
        "STATIC_ROOT": str(collected_files()),
        "ALLOWED_HOSTS": "robots.example",
        "DJANGO_SETTINGS_MODULE": "telepresence_site.settings",
        "LOG_LEVEL": "ERROR",
    }
    command = [sys.executable, "-c", ASK]
    limits = {"cwd": ROOT, "env": environment, "timeout": 120}
    done = subprocess.run(command, capture_output=True, text=True, check=False, **limits)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_a_public_server_sends_plain_http_to_https(public_server):
    assert public_server["plain"] == [301, "https://robots.example/accounts/login/"]
    assert public_server["page"] == 200


def test_cookies_of_a_public_server_are_for_https_and_hidden_from_scripts(public_server):
    assert public_server["answer"] == 302
    for name in ("sessionid", "csrftoken", "device"):
        cookie = public_server["cookies"][name]
        assert cookie == {"secure": True, "httponly": True, "samesite": "Lax"}, name


def test_public_server_sends_hsts_and_the_policies_of_pages(public_server):
    headers = public_server["headers"]
    assert int(headers["Strict-Transport-Security"].removeprefix("max-age=").split(";")[0]) >= 3600
    assert headers["X-Frame-Options"] == "DENY"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "same-origin"
    assert headers["Cross-Origin-Opener-Policy"] == "same-origin"


@pytest.mark.django_db
@pytest.mark.parametrize(
    "name",
    ["home", "about", "account_login", "account_signup", "account_reset_password", "admin:login"],
)
def test_every_page_carries_a_policy_without_inline_code(client, name):
    policy = client.get(reverse(name))["Content-Security-Policy"]
    rules = {part.split()[0]: part.split()[1:] for part in policy.split("; ")}
    assert rules["default-src"] == ["'self'"]
    assert rules["style-src"] == ["'self'"]
    assert rules["object-src"] == ["'none'"]
    assert rules["frame-ancestors"] == ["'none'"]
    assert rules["base-uri"] == ["'none'"]
    assert rules["form-action"] == ["'self'"]
    assert not [source for source in rules["script-src"] if "unsafe" in source or source == "*"]


@pytest.mark.django_db
@pytest.mark.parametrize(
    "name", ["account_login", "account_signup", "account_logout", "set_language", "profile"]
)
def test_form_of_another_site_is_refused_with_an_explanation(name):
    client = Client(enforce_csrf_checks=True)
    client.force_login(person())
    response = client.post(reverse(name), {"login": "ada", "password": PASSWORD})
    assert response.status_code == 403
    assert "The form wasn't accepted" in response.content.decode()
