"""A fresh site leads to a page that creates its administrator, once."""

import re
import threading

import pytest
from django.db import connection
from django.test import Client
from django.urls import reverse

from accounts.models import AuditEntry, User
from telepresence_site.ops import first_run, fresh_site
from telepresence_site.ops.doctor.findings import Finding
from telepresence_site.ops.doctor.report import support_report
from telepresence_site.ops.first_run import AdministratorForm, AlreadySetUpError
from tests.support.people import person
from tests.support.robots import create_robot

pytestmark = pytest.mark.django_db
SETUP = "/setup/"
FORM = {
    "username": "boss",
    "email": "boss@example.org",
    "password1": "horse battery staple 7",
    "password2": "horse battery staple 7",
}
ELSEWHERE = {"REMOTE_ADDR": "192.0.2.7"}


@pytest.fixture(autouse=True)
def fresh(monkeypatch, settings):
    monkeypatch.setattr(fresh_site._SetUp, "is_set_up", False)
    first_run.log_code.cache_clear()
    settings.TRUSTED_PROXIES = []
    settings.SECURE_PROXY_SSL_HEADER = None


@pytest.fixture
def here():
    return Client(SERVER_NAME="localhost", REMOTE_ADDR="127.0.0.1")


def test_first_page_of_a_fresh_site_creates_its_administrator(here, monkeypatch):
    finding = Finding("Mail", "warning", "No mail is sent.", "Set EMAIL_HOST.")
    monkeypatch.setattr(first_run, "examine_site", lambda: [finding])
    assert here.get("/")["Location"] == SETUP
    assert 'name="code"' not in here.get(SETUP).content.decode()
    answer = here.post(SETUP, FORM)
    assert answer["Location"] == reverse("site_checks")
    boss = User.objects.get()
    assert (boss.username, boss.is_superuser, boss.is_staff) == ("boss", True, True)
    assert AuditEntry.objects.get(act="first_administrator").actor == boss.pk
    shown = here.get(reverse("site_checks")).content.decode()
    assert "No mail is sent." in shown
    assert "Set EMAIL_HOST." in shown
    assert here.get("/").status_code == 200
    for answer in (here.get(SETUP), here.post(SETUP, FORM | {"username": "second"})):
        assert answer["Location"] == "/"
    assert User.objects.count() == 1


@pytest.mark.parametrize("existing", ["person", "robot"])
def test_site_with_an_account_or_a_robot_is_not_fresh(here, existing):
    person("ada") if existing == "person" else create_robot()
    assert here.get("/").status_code == 200
    assert here.post(SETUP, FORM)["Location"] == "/"
    assert not User.objects.filter(is_superuser=True).exists()


@pytest.mark.parametrize(
    "request_of",
    [
        pytest.param(ELSEWHERE, id="another computer"),
        pytest.param({"SERVER_NAME": "robots.example.org"}, id="another name"),
        pytest.param({"HTTP_X_FORWARDED_FOR": "192.0.2.7"}, id="proxy"),
        pytest.param({"HTTP_FORWARDED": "for=192.0.2.7"}, id="proxy of the standard"),
    ],
)
def test_page_asks_people_elsewhere_for_the_code(request_of, settings, caplog):
    settings.ALLOWED_HOSTS = ["*"]
    client = Client(**{"SERVER_NAME": "localhost", "REMOTE_ADDR": "127.0.0.1"} | request_of)
    assert 'name="code"' in client.get(SETUP).content.decode()
    for code in ({}, {"code": "wrong"}):
        assert client.post(SETUP, FORM | code).status_code == 200
    assert not User.objects.exists()
    client.get(SETUP)
    assert caplog.text.count(fresh_site.setup_code()) == 1
    entered = {"code": f" {fresh_site.setup_code().upper()} "}
    assert client.post(SETUP, FORM | entered).status_code == 302
    assert User.objects.get().is_superuser


def test_page_asks_everybody_for_the_code_behind_a_proxy(here, settings):
    settings.TRUSTED_PROXIES = ["127.0.0.1"]
    assert 'name="code"' in here.get(SETUP).content.decode()
    settings.TRUSTED_PROXIES = []
    settings.SECURE_PROXY_SSL_HEADER = ("HTTP_X_FORWARDED_PROTO", "https")
    assert 'name="code"' in here.get(SETUP, secure=True).content.decode()


def test_code_cannot_be_guessed_by_trying(settings):
    client = Client(**ELSEWHERE)
    answers = [client.post(SETUP, FORM | {"code": str(number)}).status_code for number in range(12)]
    assert answers == [200] * 10 + [429] * 2


def test_code_depends_on_the_secret_key_and_is_in_no_report(settings):
    code = fresh_site.setup_code()
    assert re.fullmatch(r"([0-9a-f]{5}-){3}[0-9a-f]{5}", code)
    finding = Finding("Administrator", "warning", "None.", f"Enter {code}.")
    assert code not in support_report([finding])
    settings.SECRET_KEY = "another"
    assert fresh_site.setup_code() != code


def test_weak_or_unequal_passwords_are_refused(here):
    for wrong in ({"password1": "12345678", "password2": "12345678"}, {"password2": "other"}):
        assert "field__error" in here.post(SETUP, FORM | wrong).content.decode()
    assert not User.objects.exists()


@pytest.mark.django_db(transaction=True)
def test_of_two_people_at_the_same_time_one_becomes_administrator():
    ready, outcomes = threading.Barrier(2), []

    def create(name):
        form = AdministratorForm(FORM | {"username": name}, needs_code=False)
        assert form.is_valid()
        ready.wait()
        try:
            outcomes.append(first_run.create_administrator(form).username)
        except AlreadySetUpError:
            outcomes.append(None)
        finally:
            connection.close()

    threads = [threading.Thread(target=create, args=[name]) for name in ("ann", "bob")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert outcomes.count(None) == 1
    assert User.objects.get().username in outcomes


def test_checks_are_for_administrators_only(client):
    client.force_login(person("staff", is_staff=True))
    assert client.get(reverse("site_checks")).status_code == 302
