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


LOCAL = ["", *ENCRYPTED, ", ".join(ENCRYPTED), *NEAR, "mqtt://pi.local"]
WEBSOCKETS = ("", "ws://127.0.0.1:8188", "wss://janus.example.org")
ICE = {"STUN_URLS": ["stun:a"], "TURN_URLS": ["turn:a"], "TURN_SECRET": "s"}
BEHIND_TLS = {"SECURE_PROXY_SSL_HEADER": ("HTTP_X_FORWARDED_PROTO", "https")}
MAIL, PROXIES, HTTP = "ACCOUNT_EMAIL_VERIFICATION", "TRUSTED_PROXIES", "HTTP_ONLY"
TWO_HOSTS = {"ALLOWED_HOSTS": ["127.0.0.1", "robots.example.org"]}
# check, settings, and the id that it reports
REPORTS = [
    *((checks.check_mqtt, {"MQTT_URL": url}, "E001") for url in MALFORMED),
    *((checks.check_mqtt, {"MQTT_PUBLIC_URL": url}, "E001") for url in MALFORMED),
    *((checks.check_mqtt, {"MQTT_PUBLIC_URL": url}, "W001") for url in PUBLIC),
    *((checks.check_mqtt, {"MQTT_PUBLIC_URL": url}, "") for url in LOCAL),
    (checks.check_ice, ICE, ""),
    (checks.check_ice, {**ICE, "TURN_SECRET": ""}, "E003"),
    (checks.check_ice, {"STUN_URLS": ["turn:a"], "TURN_URLS": []}, "E002"),
    *((checks.check_sfu, {"JANUS_URL": url}, "") for url in WEBSOCKETS),
    (checks.check_sfu, {"JANUS_URL": "http://127.0.0.1:8088/janus"}, "E009"),
    (checks.check_mail, {MAIL: "mandatory", "EMAIL_HOST": ""}, "W002"),
    (checks.check_mail, {MAIL: "always", "EMAIL_HOST": ""}, "E004"),
    (checks.check_mail, {MAIL: "optional", "EMAIL_HOST": ""}, ""),
    *((checks.check_numbers, {"GRACE_SECONDS": one}, "E005") for one in (0.0, -1.0, float("nan"))),
    (checks.check_numbers, {"SOCKETS_PER_ADDRESS": 0}, "E005"),
    (checks.check_numbers, {"SOCKETS_PER_USER": 0}, "E005"),
    (checks.check_numbers, {"IDLE_SECONDS": 0.0}, ""),
    (checks.check_numbers, {"IDLE_SECONDS": -1.0}, "E005"),
    (checks.check_proxies, {PROXIES: ["10.0.0.1", "10.0.0.0/8", "::1", "proxy"]}, "E006"),
    (checks.check_visitors_addresses, {**BEHIND_TLS, PROXIES: []}, "W008"),
    (checks.check_visitors_addresses, {**BEHIND_TLS, PROXIES: ["127.0.0.1"]}, ""),
    (checks.check_visitors_addresses, {"SECURE_PROXY_SSL_HEADER": None, PROXIES: []}, ""),
    (checks.check_plain_http, {**TWO_HOSTS, HTTP: True}, "W003"),
    (checks.check_plain_http, {**TWO_HOSTS, HTTP: False}, ""),
]


@pytest.mark.parametrize(
    ("check", "changed", "reported"),
    REPORTS,
    ids=lambda part: getattr(part, "__name__", str(part)),
)
def test_check_reports_wrong_settings_and_accepts_right_ones(settings, check, changed, reported):
    for name, value in changed.items():
        setattr(settings, name, value)
    assert found_by(check) == ([f"telepresence.{reported}"] if reported else [])
