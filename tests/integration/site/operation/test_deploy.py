"""The programs that read the files in deploy/ accept them, and they agree with the code. nginx's
file is tested with a running server, in test_server.py.
"""

import functools
import ipaddress
import os
import re
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from django.conf import settings as site

from robots.broker.listeners import Listeners, Tls
from robots.broker.mosquitto import configuration
from telepresence_site.serving import APPLICATION, DAPHNE
from telepresence_site.web.asgi_limits import MAX_BODY
from tests.support.agents.simulators import eventually
from tests.support.programs import finished
from tests.support.programs.deployed import compose, kustomization
from tests.support.programs.server import program
from tests.support.sessions.site import free_port

ROOT = Path(site.BASE_DIR)
DEPLOY = ROOT / "deploy"
UNITS = sorted((DEPLOY / "systemd").iterdir())
PYTHON = "/opt/telepresence/.venv/bin/python"


def run(*command, **options):
    done = finished.run(*command, **options)
    return done.returncode, done.stdout + done.stderr


def example():
    lines = (DEPLOY / "telepresence.env.example").read_text()
    return dict(re.findall(r"^([^#=\n]+)=(.*)$", lines, re.MULTILINE))


def settings_of_compose():
    environment = compose("compose.yaml")["web-1"].around["environment"]
    return {
        name: re.sub(r"\$\{\w+_PASSWORD:\?\}", "x", value).replace(
            "${SITE_HOST:?}", "robots.example.org"
        )
        for name, value in environment.items()
    }


def settings_of_kubernetes(folder):
    made = [one for name in ("base", folder) for one in kustomization(name)["configMapGenerator"]]
    return dict(line.split("=", 1) for one in made for line in one.get("literals", ()))


@pytest.mark.nightly
@pytest.mark.parametrize("place", ["machine", "compose", "one", "many"])
def test_example_environment_passes_the_deployment_check(place, tmp_path):
    own = {
        "machine": dict,
        "compose": settings_of_compose,
        "one": functools.partial(settings_of_kubernetes, "one"),
        "many": functools.partial(settings_of_kubernetes, "many"),
    }
    (tmp_path / "static").mkdir()
    filled = {
        name: value.replace("CHANGE", "Changed-" + "aB3dE5gH7jK9" * 5)
        for name, value in example().items()
    }
    filled |= own[place]() | {"STATIC_ROOT": str(tmp_path / "static")}
    filled.pop("VAR_DIR", None)
    environment = finished.site_environment(tmp_path / "var", **filled)
    command = ["manage.py", "check", "--deploy", "--fail-level", "WARNING"]
    code, output = run(sys.executable, *command, env=environment)
    assert code == 0, output
    assert "no issues" in output


@pytest.mark.parametrize("place", ["machine", "compose"])
def test_caddy_accepts_its_file(place, tmp_path):
    environment = {"PATH": os.environ["PATH"]}
    environment |= dict.fromkeys(("HOME", "XDG_DATA_HOME", "XDG_CONFIG_HOME"), str(tmp_path))
    if place == "compose":
        environment |= compose("compose.yaml")["proxy"].around["environment"]
        environment["SITE_HOST"] = "robots.example.com"
    file = str(DEPLOY / "proxy/Caddyfile")
    words = ["validate", "--adapter", "caddyfile", "--config", file]
    code, output = run(program("caddy"), *words, env=environment)
    assert code == 0, output
    assert "Valid configuration" in output


def test_caddy_closes_a_connection_whose_request_never_ends(tmp_path):
    port = free_port()
    text = (DEPLOY / "proxy/Caddyfile").read_text()
    assert "read_header 10s" in text
    quick = text.replace("read_header 10s", "read_header 1s").replace(
        "\tservers", "\tadmin off\n\tservers"
    )
    (tmp_path / "Caddyfile").write_text(quick)
    words = ["run", "--adapter", "caddyfile", "--config", str(tmp_path / "Caddyfile")]
    environment = {"PATH": os.environ["PATH"], "HOME": str(tmp_path)}
    environment["SITE_HOST"] = f"http://127.0.0.1:{port}"
    with subprocess.Popen(
        [program("caddy"), *words], env=environment, stderr=subprocess.DEVNULL
    ) as caddy:
        try:
            assert eventually(lambda: is_closed(port))
        finally:
            caddy.terminate()


def is_closed(port: int) -> bool:
    """Send half a request; return whether the other end then closes the connection."""
    try:
        with socket.create_connection(("127.0.0.1", port), 1.0) as client:
            client.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n")
            client.settimeout(8.0)
            return client.recv(100) == b""
    except (ConnectionRefusedError, TimeoutError):
        return False


INNER = (
    "127.0.0.1",
    "10.1.2.3",
    "192.168.1.1",
    "169.254.169.254",
    "::",
    "::1",
    "fd00::1",
    "fe80::1",
)
MAPPED = ("::127.0.0.1", "::ffff:10.1.2.3", "64:ff9b::a01:203", "2002:a01:203::1")


@pytest.mark.parametrize("address", [*INNER, *MAPPED])
def test_relay_reaches_no_inner_network_also_by_mapped_addresses(address):
    ranges = re.findall(
        r"^denied-peer-ip=([^-\n]+)-(\S+)$",
        (DEPLOY / "coturn/turnserver.conf").read_text(),
        re.MULTILINE,
    )
    wanted = ipaddress.ip_address(address)
    pairs = [(ipaddress.ip_address(first), ipaddress.ip_address(last)) for first, last in ranges]
    assert any(first <= wanted <= last for first, last in pairs if first.version == wanted.version)


def test_systemd_accepts_every_unit(tmp_path):
    for unit in UNITS:  # with programs of this computer
        text = (
            unit.read_text()
            .replace(PYTHON, sys.executable)
            .replace("/opt/telepresence", str(ROOT))
            .replace("/usr/sbin/nats-server", sys.executable)
        )
        text = re.sub(r"^EnvironmentFile=.*$", "", text, flags=re.MULTILINE)
        (tmp_path / unit.name).write_text(text)
    names = [str(tmp_path / unit.name.replace("@.", "@example.")) for unit in UNITS]
    for unit in UNITS:
        if "@." in unit.name:
            shutil.copy(tmp_path / unit.name, tmp_path / unit.name.replace("@.", "@example."))
    options = ["verify", "--man=no", "--recursive-errors=no"]
    code, output = run(program("systemd-analyze"), *options, *names)
    lines = [line for line in output.splitlines() if "mosquitto.service" not in line]
    assert (code, [line for line in lines if "telepresence" in line]) == (0, []), output


SERVICES = [unit for unit in UNITS if unit.suffix == ".service"]
# they control other services
BY_ROOT = {
    f"telepresence-{name}.service" for name in ("mosquitto-reload", "nats-reload", "certificates@")
}


@pytest.mark.parametrize(
    "unit", [unit for unit in SERVICES if unit.name not in BY_ROOT], ids=lambda unit: unit.name
)
def test_every_process_is_restarted_and_has_few_rights(unit):
    text = unit.read_text()
    again = (
        unit.with_suffix(".timer").exists()
        if "Type=oneshot" in text
        else re.search("^Restart=always$", text, re.MULTILINE)
    )
    assert again, "neither restarted nor started by a timer"
    # systemd.unit(5): by default a unit is not started more than five times within ten seconds.
    assert "Type=oneshot" in text or "\nStartLimitIntervalSec=0\n" in text
    assert re.search(r"^(User=telepresence|User=nats|DynamicUser=yes)$", text, re.MULTILINE)
    assert re.search(r"^CapabilityBoundingSet=$", text, re.MULTILINE)


# The options with the largest effect on systemd's own measure that break no program of ours.
PROTECTED = ("KernelTunables", "KernelModules", "KernelLogs", "ControlGroups", "Hostname", "Home")
HARDENING = {
    *(f"Protect{name}=yes" for name in PROTECTED),
    *("ProtectSystem=strict", "ProtectProc=invisible", "NoNewPrivileges=yes", "PrivateTmp=yes"),
    *("RestrictNamespaces=yes", "RestrictSUIDSGID=yes", "LockPersonality=yes"),
    *("SystemCallArchitectures=native", "SystemCallFilter=@system-service"),
    "AmbientCapabilities=",
}
MOST_EXPOSED = 3.0  # of 10


@pytest.mark.parametrize("unit", SERVICES, ids=lambda unit: unit.name)
def test_every_service_is_hardened_also_those_of_root(unit, tmp_path):
    lines = unit.read_text().splitlines()
    assert HARDENING - set(lines) == set()
    assert any(line.startswith("CapabilityBoundingSet=") for line in lines)
    if shutil.which("systemd-analyze") is None:
        return
    plain = tmp_path / unit.name.replace("@.", "@example.")
    shutil.copy(unit, plain)
    options = ["security", "--no-pager", "--offline=true"]
    code, output = run("systemd-analyze", *options, str(plain))
    assert code == 0, output
    (exposure,) = re.findall(r"Overall exposure level for \S+: ([\d.]+)", output)
    assert float(exposure) <= MOST_EXPOSED, output


def test_old_data_is_deleted_once_a_day_also_after_the_computer_was_off():
    timer = (DEPLOY / "systemd/telepresence-forget.timer").read_text()
    (calendar,) = re.findall(r"^OnCalendar=(.*)$", timer, re.MULTILINE)
    words = ["calendar", "--iterations=3", "--base-time=2026-03-01 12:00:00 UTC", calendar]
    code, output = run(program("systemd-analyze"), *words, env={**os.environ, "TZ": "UTC"})
    assert code == 0, output
    days = re.findall(r"2026-03-(\d\d) \S+ UTC", output.partition("Next elapse")[2])
    assert days == ["02", "03", "04"], output
    assert re.search(r"^Persistent=true$", timer, re.MULTILINE)
    service = (DEPLOY / "systemd/telepresence-forget.service").read_text()
    assert f"ExecStart={PYTHON} manage.py forget\n" in service


@pytest.fixture
def machine(tmp_path):
    """A root folder with a certificate of Caddy's and the folders of its users."""
    for name in ("etc/mosquitto/certs", "etc/coturn/certs", "bin"):
        (tmp_path / name).mkdir(parents=True)
    caddys = tmp_path / "var/lib/caddy/.local/share/caddy/certificates/acme/robots.example.org"
    caddys.mkdir(parents=True)
    (tmp_path / "bin/systemctl").write_text(f'#!/bin/sh\necho "$@" >> {tmp_path}/calls\n')
    (tmp_path / "bin/systemctl").chmod(0o755)

    class Machine:
        def has_certificate(self, text):
            for suffix in ("crt", "key"):
                (caddys / f"robots.example.org.{suffix}").write_text(f"{text} {suffix}")

        def copy(self, host="robots.example.org"):
            """Return (exit code, output, calls of systemctl)."""
            path = f"{tmp_path}/bin:{os.environ['PATH']}"
            environment = os.environ | {"ROOT": str(tmp_path), "PATH": path}
            code, output = run("sh", DEPLOY / "copy_certificates.sh", host, env=environment)
            calls = tmp_path / "calls"
            called = calls.read_text() if calls.exists() else ""
            calls.unlink(missing_ok=True)
            return code, output, called

        def file(self, name):
            return tmp_path / name

    return Machine()


def test_new_certificate_of_the_proxy_is_copied_to_the_installed_servers(machine):
    machine.has_certificate("first")
    code, output, called = machine.copy()
    assert code == 0, output
    assert called.splitlines() == [
        "try-reload-or-restart mosquitto",
        "is-active --quiet coturn",
        "kill --signal=SIGUSR2 coturn",
    ]
    for folder in ("mosquitto", "coturn"):
        key = machine.file(f"etc/{folder}/certs/privkey.pem")
        assert (key.read_text(), key.stat().st_mode & 0o777) == ("first key", 0o640)
        assert machine.file(f"etc/{folder}/certs/fullchain.pem").read_text() == "first crt"
    assert machine.copy() == (0, "", "")
    machine.file("etc/telepresence/certs").mkdir(parents=True)
    assert machine.copy()[2] == "try-restart telepresence-broker\n"
    machine.has_certificate("second")
    assert len(machine.copy()[2].splitlines()) == 4
    assert machine.file("etc/mosquitto/certs/privkey.pem").read_text() == "second key"


def test_missing_certificate_of_the_proxy_is_reported(machine):
    code, output, called = machine.copy()
    assert (code, called) == (1, "")
    assert "no certificate of robots.example.org yet" in output


def test_certbots_certificate_is_copied_too(machine):
    live = machine.file("etc/letsencrypt/live/robots.example.org")
    live.mkdir(parents=True)
    (live / "fullchain.pem").write_text("chain")
    (live / "privkey.pem").write_text("key")
    assert machine.copy()[0] == 0
    assert machine.file("etc/mosquitto/certs/privkey.pem").read_text() == "key"


def test_certificates_are_copied_to_the_folders_that_the_servers_read():
    script = (DEPLOY / "copy_certificates.sh").read_text()
    users = ("mosquitto/telepresence.conf", "coturn/turnserver.conf")
    for file in (*users, "systemd/telepresence-broker.service"):
        text = (DEPLOY / file).read_text()
        (folder,) = set(re.findall(r"(/etc/\S+)/(?:fullchain|privkey)\.pem", text))
        assert f"put {folder}\n" in script


def test_proxies_have_the_sites_limit_of_request_bodies():
    (caddy,) = re.findall(r"max_size (\d+)MiB", (DEPLOY / "proxy/Caddyfile").read_text())
    nginx_file = (DEPLOY / "proxy/nginx.conf").read_text()
    (nginx,) = re.findall(r"client_max_body_size (\d+)m;", nginx_file)
    assert int(caddy) * 1024 * 1024 == int(nginx) * 1024 * 1024 == MAX_BODY


def test_web_unit_starts_daphne_as_the_demo_does():
    text = (DEPLOY / "systemd/telepresence-web@.service").read_text()
    assert f"ExecStart={PYTHON} {' '.join(DAPHNE)} -b 127.0.0.1 -p %i {APPLICATION}\n" in text


@pytest.mark.nightly
def test_units_call_existing_commands_with_existing_options():
    for unit in UNITS:
        calls = re.findall(r"manage\.py (\w+)(.*)$", unit.read_text(), re.MULTILINE)
        for command, arguments in calls:
            code, output = run(sys.executable, "manage.py", command, "--help")
            assert code == 0
            missing = [one for one in re.findall(r"--[a-z-]+", arguments) if one not in output]
            assert not missing, unit.name


def test_mosquittos_file_has_the_limits_of_our_own(tmp_path):
    given = (DEPLOY / "mosquitto/telepresence.conf").read_text().splitlines()
    listeners = Listeners("127.0.0.1", 1883, Tls(tmp_path / "c", tmp_path / "k"))
    ours = configuration(listeners, tmp_path).splitlines()
    bounds = ("max_", "set_tcp", "autosave", "persistent_client", "allow_anonymous")
    assert [line for line in ours if line.startswith(bounds) and line not in given] == []


def test_proxies_and_site_agree_on_the_form_of_hashed_names():
    from telepresence_site.web.static_files import HashedModules

    name = HashedModules(location=str(ROOT / "static")).hashed_name("css/_global.css")
    for file in ("Caddyfile", "nginx.conf"):
        pattern = re.search(r"\^/static/\S+?\$", (DEPLOY / "proxy" / file).read_text())[0]
        assert re.fullmatch(pattern, f"/static/{name}")
        assert not re.fullmatch(pattern, "/static/css/_global.css")
