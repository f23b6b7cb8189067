"""What the site lacks to serve visitors, and the report for a request for help."""

import re
import socket
import ssl
import sys
import threading

import pytest
from django.core.management import call_command
from django.db import OperationalError
from django.utils import timezone

from sessions.models import ManagerBeat
from telepresence_site.ops.doctor import findings, services
from tests.support.programs.coturn import SECRET, Coturn
from tests.support.programs.finished import run, site_environment
from tests.support.programs.server import certificate

SECRETS = {
    "SECRET_KEY": "k7-secret-key-of-this-site-k7",
    "EMAIL_HOST_PASSWORD": "mail-password-81",
    "TURN_SECRET": "turn-secret-82",
    "JANUS_SECRET": "janus-secret-83",
    "METRICS_TOKEN": "metrics-token-84",
    "DEMO_TOKEN": "demo-token-85",
}
PASSWORDS = ("broker-password-86", "redis-password-87")
SCREEN_KEY = "screen-key-88"


def states(check):
    return [finding.state for finding in check()]


def details(check):
    return " ".join(f"{finding.detail} {finding.advice}" for finding in check())


def closed_port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def test_report_has_no_secret_of_the_settings_also_of_the_logs(tmp_path):
    values = SECRETS | {
        "MQTT_URL": f"mqtt://site:{PASSWORDS[0]}@127.0.0.1:{closed_port()}",
        "REDIS_URL": f"redis://:{PASSWORDS[1]}@127.0.0.1:6379",
        "HTTP_ONLY": "1",
        "TURN_MINUTES": "12.5",
    }
    hidden = [*SECRETS.values(), *PASSWORDS]
    (tmp_path / "var" / "secrets").mkdir(parents=True, mode=0o700)
    (tmp_path / "var" / "secrets" / "another").write_text("stored-secret-90\n")
    log = tmp_path / "web.log"
    log.write_text(f"{' '.join(hidden)} cookie: screen-giraff={SCREEN_KEY} stored-secret-90 END")
    report = tmp_path / "report.txt"
    command = ["manage.py", "doctor", "--report", str(report), "--log", str(log)]
    done = run(sys.executable, *command, env=site_environment(tmp_path / "var", **values))
    text = report.read_text()
    for secret in (*hidden, SCREEN_KEY, "stored-secret-90"):
        assert secret not in text
        assert secret not in done.stdout + done.stderr
    assert report.stat().st_mode & 0o077 == 0
    assert "END" in text
    assert "SECRET_KEY = (set)" in text
    assert "TURN_MINUTES = 12.5" in text
    assert "MQTT_URL = mqtt://(set)" in text
    assert re.search(r"^Django \d", text, re.MULTILINE)
    assert done.returncode == 1  # the database has no tables yet
    assert "Run manage.py migrate." in done.stdout


@pytest.mark.django_db
def test_database_that_is_migrated_is_ok_and_one_that_does_not_answer_is_not(monkeypatch):
    assert states(findings.database) == ["ok"]

    def fails(_connection):
        raise OperationalError("no such host")

    monkeypatch.setattr(findings, "MigrationExecutor", fails)
    assert states(findings.database) == ["error"]
    assert "no such host" in details(findings.database)


@pytest.mark.django_db
@pytest.mark.parametrize(
    ("beat", "state", "words"),
    [
        (None, "error", "It has never run."),
        ({"connected": True}, "ok", "It is running."),
        ({"connected": False}, "error", "It can't reach the broker."),
    ],
)
def test_session_manager_is_judged_by_its_heartbeat(beat, state, words):
    if beat is not None:
        ManagerBeat.objects.create(
            name=findings.NAME, holder="h", beat_at=timezone.now(), report=beat
        )
    assert states(findings.session_manager) == [state]
    assert words in details(findings.session_manager)


def test_mail_without_a_server_is_a_warning_and_a_server_that_is_away_an_error(settings):
    settings.EMAIL_HOST = ""
    assert states(services.mail_server) == ["warning"]
    settings.EMAIL_HOST, settings.EMAIL_PORT = "127.0.0.1", closed_port()
    settings.EMAIL_BACKEND = "django.core.mail.backends.smtp.EmailBackend"
    assert states(services.mail_server) == ["error"]


def test_address_of_this_computer_only_is_a_warning_and_plain_http_an_error(settings):
    settings.ALLOWED_HOSTS, settings.HTTP_ONLY = ["127.0.0.1", "localhost"], True
    assert states(services.public_address) == ["warning"]
    settings.ALLOWED_HOSTS = ["localhost", "robots.example.org"]
    assert states(services.public_address) == ["error"]


@pytest.fixture
def tls_server(tmp_path):
    """A server on this computer with a certificate that no browser knows."""
    key, file = certificate(tmp_path, "localhost")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(file, key)
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve():
            try:
                while True:
                    connection, _address = listening.accept()
                    with connection:
                        try:
                            context.wrap_socket(connection, server_side=True).close()
                        except OSError:
                            continue
            except OSError:
                return

        threading.Thread(target=serve, daemon=True).start()
        yield listening.getsockname()[1], file


def test_certificate_must_be_known_to_browsers(settings, monkeypatch, tls_server):
    port, file = tls_server
    monkeypatch.setattr(services, "HTTPS", port)
    monkeypatch.setattr(services, "LOOPBACK_NAMES", set())
    settings.HTTP_ONLY, settings.ALLOWED_HOSTS = False, ["localhost"]
    assert states(services.public_address) == ["error"]
    assert "Browsers do not accept the certificate of localhost" in details(services.public_address)
    known = ssl.create_default_context(cafile=str(file))
    monkeypatch.setattr(services.ssl, "create_default_context", lambda: known)
    assert "is valid for" in details(services.public_address)
    monkeypatch.setattr(services, "HTTPS", closed_port())
    assert "does not answer from here" in details(services.public_address)


def test_broker_that_is_away_is_an_error(settings):
    settings.MQTT_URL = f"mqtt://127.0.0.1:{closed_port()}"
    assert states(services.broker) == ["error"]
    settings.MQTT_URL = "http://127.0.0.1"
    assert "must begin with" in details(services.broker)


def test_no_turn_server_is_a_warning_and_one_that_is_away_an_error(settings):
    settings.TURN_URLS = []
    assert states(services.turn_servers) == ["warning"]
    address = f"turn:127.0.0.1:{closed_port()}?transport=tcp"
    settings.TURN_URLS, settings.TURN_SECRET = [address], "shared"
    assert states(services.turn_servers) == ["error"]


def test_turn_server_that_gives_a_relay_is_ok_unless_the_secret_is_wrong(settings, tmp_path):
    with Coturn(tmp_path) as relay:
        settings.TURN_URLS = [
            f"eu=turn:127.0.0.1:{relay.port}",
            f"turn:127.0.0.1:{relay.port}?transport=tcp",
        ]
        settings.TURN_SECRET = SECRET
        assert states(services.turn_servers) == ["ok", "ok"]
        settings.TURN_SECRET = "not what coturn has"
        assert states(services.turn_servers) == ["error", "error"]


@pytest.mark.parametrize(("answer", "state"), [("yes", "ok"), ("no", "error"), ("", "warning")])
def test_clock_is_judged_by_what_the_system_says(tmp_path, monkeypatch, answer, state):
    program = tmp_path / "timedatectl"
    program.write_text(f"#!/bin/sh\necho {answer}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    assert states(findings.clock) == [state]


@pytest.mark.django_db
def test_command_lists_each_part_and_fails_if_one_is_wrong(settings, capsys):
    settings.MQTT_URL = f"mqtt://127.0.0.1:{closed_port()}"
    with pytest.raises(SystemExit) as ended:
        call_command("doctor")
    assert ended.value.code == 1
    shown = capsys.readouterr().out
    for part in ("Database", "Storage", "Clock", "Broker", "Mail", "TURN server"):
        assert f"{part}: " in shown
