"""Wrong settings are reported when a command starts."""

import sys

import pytest
from django.core.checks import run_checks

from telepresence_site import checks
from tests.support.programs.finished import run, site_environment

PRODUCTION = {
    "SECRET_KEY": "k" * 30 + "abcdefghijklmnopqrstuvwxyz0123456789",
    "ALLOWED_HOSTS": "robots.example.org",
    "REDIS_URL": "redis://127.0.0.1:6379",
    "DATABASE_URL": "postgres://telepresence@127.0.0.1/telepresence",
    "MQTT_URL": "mqtt://127.0.0.1:1883",
    "MQTT_PUBLIC_URL": "mqtts://{host}:8883",
    "STUN_URLS": "stun:robots.example.org",
    "TURN_URLS": "turn:robots.example.org,turns:robots.example.org?transport=tcp",
    "TURN_SECRET": "shared",
    "EMAIL_VERIFICATION": "mandatory",
    "EMAIL_HOST": "mail.example.org",
    "TRUSTED_PROXIES": "127.0.0.1,10.0.0.0/8",
    "BEHIND_TLS_PROXY": "1",
    "HSTS_SECONDS": "31536000",
    "HSTS_SUBDOMAINS": "1",
    "HSTS_PRELOAD": "1",
}


def found_by(check):
    return [message.id for message in check()]


def check_deploy(tmp_path, *, folder=0o700, **changed):
    (tmp_path / "var").mkdir(mode=folder)
    (tmp_path / "var" / "static").mkdir()
    environment = site_environment(tmp_path / "var", **PRODUCTION | changed)
    command = ["manage.py", "check", "--deploy", "--fail-level", "WARNING"]
    return run(sys.executable, *command, env=environment)


@pytest.mark.nightly
def test_correct_server_passes_the_deployment_check_silently(tmp_path):
    result = check_deploy(tmp_path)
    assert result.returncode == 0, result.stderr
    assert "no issues" in result.stdout


@pytest.mark.nightly
def test_careless_server_gets_a_warning_for_each_mistake(tmp_path):
    careless = dict.fromkeys(("SECRET_KEY", "REDIS_URL", "EMAIL_HOST", "BEHIND_TLS_PROXY"), "")
    careless |= {"HTTP_ONLY": "1", "MQTT_PUBLIC_URL": "mqtt://{host}:1883", "DEMO_TOKEN": "x"}
    result = check_deploy(tmp_path, **careless, folder=0o755)
    assert result.returncode != 0
    for identifier in ("W001", "W002", "W003", "W004", "W005", "W006", "W009"):
        assert f"telepresence.{identifier}" in result.stderr
    assert "security.W012" in result.stderr  # Django's own warning about cookies over plain http


def test_settings_of_the_tests_pass_every_check():
    assert [message for message in run_checks() if message.id.startswith("telepresence.")] == []


def test_command_warns_of_a_nearly_full_disk_when_it_starts(settings):
    assert found_by(checks.check_disk) == []
    settings.DISK_LOW_MB = 1e9
    assert found_by(checks.check_disk) == ["telepresence.W010"]


MALFORMED = [
    *("localhost:1883", "http://broker", "mqtt://", "mqtt://broker:port", "mqtt://broker:99999"),
    *("mqtts://broker.example.org,", "mqtts://broker.example.org,wss:/broker"),
]
PUBLIC = [
    *("mqtt://broker.example.org", "ws://broker.example.org:9001"),
    *("mqtt://{host}:1883", "mqtt://8.8.8.8"),
]
ENCRYPTED = ["mqtts://broker.example.org", "wss://broker.example.org/mqtt"]
NEAR = ["mqtt://127.0.0.1:1883", "mqtt://[::1]", "mqtt://10.0.0.7", "mqtt://broker"]


@pytest.mark.parametrize("url", MALFORMED)
@pytest.mark.parametrize("name", ["MQTT_URL", "MQTT_PUBLIC_URL"])
def test_malformed_broker_address_is_an_error(settings, name, url):
    setattr(settings, name, url)
    assert found_by(checks.check_mqtt) == ["telepresence.E001"]


@pytest.mark.parametrize("url", PUBLIC)
def test_unencrypted_tokens_over_a_public_network_are_a_warning(settings, url):
    settings.MQTT_PUBLIC_URL = url
    assert found_by(checks.check_mqtt) == ["telepresence.W001"]


@pytest.mark.parametrize("url", ["", *ENCRYPTED, ", ".join(ENCRYPTED), *NEAR, "mqtt://pi.local"])
def test_encrypted_or_local_broker_is_accepted(settings, url):
    settings.MQTT_PUBLIC_URL = url
    assert found_by(checks.check_mqtt) == []


def test_ice_servers_are_checked(settings):
    settings.STUN_URLS, settings.TURN_URLS, settings.TURN_SECRET = ["stun:a"], ["turn:a"], "s"
    assert found_by(checks.check_ice) == []
    settings.TURN_SECRET = ""
    assert found_by(checks.check_ice) == ["telepresence.E003"]
    settings.STUN_URLS, settings.TURN_URLS = ["turn:a"], []
    assert found_by(checks.check_ice) == ["telepresence.E002"]


def test_sfu_address_must_be_of_a_websocket(settings):
    for url in ("", "ws://127.0.0.1:8188", "wss://janus.example.org"):
        settings.JANUS_URL = url
        assert found_by(checks.check_sfu) == []
    settings.JANUS_URL = "http://127.0.0.1:8088/janus"
    assert found_by(checks.check_sfu) == ["telepresence.E009"]


def test_verification_by_mail_is_checked(settings):
    settings.ACCOUNT_EMAIL_VERIFICATION, settings.EMAIL_HOST = "mandatory", ""
    assert found_by(checks.check_mail) == ["telepresence.W002"]
    settings.ACCOUNT_EMAIL_VERIFICATION = "always"
    assert found_by(checks.check_mail) == ["telepresence.E004"]
    settings.ACCOUNT_EMAIL_VERIFICATION = "optional"
    assert found_by(checks.check_mail) == []


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_times_must_be_positive(settings, value):
    settings.GRACE_SECONDS = value
    assert found_by(checks.check_numbers) == ["telepresence.E005"]


@pytest.mark.parametrize("name", ["SOCKETS_PER_ADDRESS", "SOCKETS_PER_USER"])
def test_limit_that_admits_no_visitor_is_an_error(settings, name):
    setattr(settings, name, 0)
    assert found_by(checks.check_numbers) == ["telepresence.E005"]


def test_presence_question_may_be_off_but_not_negative(settings):
    settings.IDLE_SECONDS = 0.0
    assert found_by(checks.check_numbers) == []
    settings.IDLE_SECONDS = -1.0
    assert found_by(checks.check_numbers) == ["telepresence.E005"]


def test_proxy_must_be_an_address_or_a_network(settings):
    settings.TRUSTED_PROXIES = ["10.0.0.1", "10.0.0.0/8", "::1", "proxy"]
    assert found_by(checks.check_proxies) == ["telepresence.E006"]


def test_server_behind_an_unnamed_proxy_is_a_warning(settings):
    settings.SECURE_PROXY_SSL_HEADER = ("HTTP_X_FORWARDED_PROTO", "https")
    settings.TRUSTED_PROXIES = []
    assert found_by(checks.check_visitors_addresses) == ["telepresence.W008"]
    settings.TRUSTED_PROXIES = ["127.0.0.1"]
    assert found_by(checks.check_visitors_addresses) == []
    settings.SECURE_PROXY_SSL_HEADER, settings.TRUSTED_PROXIES = None, []
    assert found_by(checks.check_visitors_addresses) == []


def test_plain_http_for_other_computers_is_a_warning(settings):
    settings.HTTP_ONLY, settings.ALLOWED_HOSTS = True, ["127.0.0.1", "robots.example.org"]
    assert found_by(checks.check_plain_http) == ["telepresence.W003"]
    settings.HTTP_ONLY = False
    assert found_by(checks.check_plain_http) == []
