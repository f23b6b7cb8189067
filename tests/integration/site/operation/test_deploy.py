"""The files in deploy/ are valid in the eyes of the programs that read them, and say the same as
the code.
"""

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
from tests.support.programs.deployed import compose, kustomization
from tests.support.programs.server import certificate, program
from tests.support.sessions.site import free_port

ROOT = Path(site.BASE_DIR)
DEPLOY = ROOT / "deploy"
UNITS = sorted((DEPLOY / "systemd").iterdir())
PYTHON = "/opt/telepresence/.venv/bin/python"


def run(*command, **options):
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=120, check=False, **options
    )
    return done.returncode, done.stdout + done.stderr


def example():
    lines = (
        line
        for line in (DEPLOY / "telepresence.env.example").read_text().splitlines()
        if line and not line.startswith("#")
    )
    return dict(line.split("=", 1) for line in lines)


def told_in_compose():
    environment = compose("compose.yaml")["web-1"].around["environment"]
    return {
        name: re.sub(
            r"\$\{\w+_PASSWORD:\?\}", "x", value.replace("${SITE_HOST:?}", "robots.example.org")
        )
        for name, value in environment.items()
    }


def told_in_kubernetes(folder):
    made = [one for name in ("base", folder) for one in kustomization(name)["configMapGenerator"]]
    return dict(line.split("=", 1) for one in made for line in one.get("literals", ()))


@pytest.mark.nightly
@pytest.mark.parametrize(
    "told",
    [
        pytest.param({}, id="machine"),
        pytest.param(told_in_compose(), id="compose"),
        pytest.param(told_in_kubernetes("one"), id="one"),
        pytest.param(told_in_kubernetes("many"), id="many"),
    ],
)
def test_the_example_environment_passes_the_deployment_check_without_a_word(told, tmp_path):
    (tmp_path / "static").mkdir()
    filled = {
        name: value.replace("CHANGE", "Changed-" + "aB3dE5gH7jK9" * 5)
        for name, value in example().items()
    }
    filled |= told
    filled |= {
        "VAR_DIR": str(tmp_path / "var"),
        "STATIC_ROOT": str(tmp_path / "static"),
        "DJANGO_SETTINGS_MODULE": "telepresence_site.settings",
    }
    kept = {
        name: value
        for name, value in os.environ.items()
        if name in {"PATH", "HOME", "LANG", "VIRTUAL_ENV"}
    }
    code, said = run(
        sys.executable,
        "manage.py",
        "check",
        "--deploy",
        "--fail-level",
        "WARNING",
        cwd=ROOT,
        env=kept | filled,
    )
    assert code == 0, said
    assert "no issues" in said


def test_every_name_in_the_example_environment_is_a_setting():
    explained = set(re.findall(r"`([A-Z_]+)`", (ROOT / "docs/reference/settings.md").read_text()))
    assert set(example()) <= explained


@pytest.mark.parametrize("place", ["machine", "compose"])
def test_caddy_takes_its_file(place, tmp_path):
    told = compose("compose.yaml")["proxy"].around["environment"] if place == "compose" else {}
    environment = {
        **told,
        **({"SITE_HOST": "robots.example.com"} if told else {}),
        "PATH": os.environ["PATH"],
        "HOME": str(tmp_path),
        "XDG_DATA_HOME": str(tmp_path),
        "XDG_CONFIG_HOME": str(tmp_path),
    }
    code, said = run(
        program("caddy"),
        "validate",
        "--adapter",
        "caddyfile",
        "--config",
        str(DEPLOY / "proxy/Caddyfile"),
        env=environment,
    )
    assert code == 0, said
    assert "Valid configuration" in said


def test_caddy_closes_a_connection_whose_request_never_ends(tmp_path):
    port = free_port()
    text = (DEPLOY / "proxy/Caddyfile").read_text()
    assert "read_header 10s" in text
    quick = text.replace("read_header 10s", "read_header 1s").replace(
        "\tservers", "\tadmin off\n\tservers"
    )
    (tmp_path / "Caddyfile").write_text(quick)
    with subprocess.Popen(
        [
            program("caddy"),
            "run",
            "--adapter",
            "caddyfile",
            "--config",
            str(tmp_path / "Caddyfile"),
        ],
        env={
            "PATH": os.environ["PATH"],
            "HOME": str(tmp_path),
            "SITE_HOST": f"http://127.0.0.1:{port}",
        },
        stderr=subprocess.DEVNULL,
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


@pytest.mark.parametrize(
    "address",
    [
        "127.0.0.1",
        "10.1.2.3",
        "192.168.1.1",
        "169.254.169.254",
        "::",
        "::1",
        "::127.0.0.1",
        "::ffff:10.1.2.3",
        "64:ff9b::a01:203",
        "2002:a01:203::1",
        "fd00::1",
        "fe80::1",
    ],
)
def test_the_relay_leads_into_no_inner_network_also_not_by_ipv4_in_the_clothes_of_ipv6(address):
    ranges = re.findall(
        r"^denied-peer-ip=([^-\n]+)-(\S+)$",
        (DEPLOY / "coturn/turnserver.conf").read_text(),
        re.MULTILINE,
    )
    wanted = ipaddress.ip_address(address)
    pairs = [(ipaddress.ip_address(first), ipaddress.ip_address(last)) for first, last in ranges]
    assert any(first <= wanted <= last for first, last in pairs if first.version == wanted.version)


def test_nginx_takes_its_file(tmp_path):
    key, chain = certificate(tmp_path)
    text = (DEPLOY / "proxy/nginx.conf").read_text()
    text = text.replace("/etc/letsencrypt/live/robots.example.org/privkey.pem", str(key)).replace(
        "/etc/letsencrypt/live/robots.example.org/fullchain.pem", str(chain)
    )
    text = (
        text.replace("/var/log/nginx/", f"{tmp_path}/")
        .replace("listen 80;", "listen 127.0.0.1:18080;")
        .replace("listen [::]:80;", "")
    )
    text = text.replace("listen 443 ssl http2;", "listen 127.0.0.1:18443 ssl http2;").replace(
        "listen [::]:443 ssl http2;", ""
    )
    (tmp_path / "nginx.conf").write_text(
        f"pid {tmp_path}/pid;\nerror_log stderr;\nevents {{}}\nhttp {{\ninclude"
        f" /etc/nginx/mime.types;\n{text}\n}}\n"
    )
    code, said = run(
        program("nginx"), "-t", "-p", str(tmp_path), "-c", str(tmp_path / "nginx.conf")
    )
    assert code == 0, said
    assert "test is successful" in said


def test_systemd_takes_every_unit(tmp_path):
    for unit in UNITS:  # the programs of this computer stand in for those of the server
        text = (
            unit.read_text()
            .replace(PYTHON, sys.executable)
            .replace("/opt/telepresence", str(ROOT))
            .replace("/usr/sbin/nats-server", sys.executable)
        )
        (tmp_path / unit.name).write_text(
            re.sub(r"^EnvironmentFile=.*$", "", text, flags=re.MULTILINE)
        )
    names = [str(tmp_path / unit.name.replace("@.", "@example.")) for unit in UNITS]
    for unit in UNITS:
        if "@." in unit.name:
            shutil.copy(tmp_path / unit.name, tmp_path / unit.name.replace("@.", "@example."))
    code, said = run(
        program("systemd-analyze"), "verify", "--man=no", "--recursive-errors=no", *names
    )
    own = [
        line
        for line in said.splitlines()
        if "telepresence" in line and "mosquitto.service" not in line
    ]
    assert (code, own) == (0, []), said


# they tell other services something
BY_ROOT = {
    "telepresence-mosquitto-reload.service",
    "telepresence-nats-reload.service",
    "telepresence-certificates@.service",
}


@pytest.mark.parametrize(
    "unit",
    [unit for unit in UNITS if unit.suffix == ".service" and unit.name not in BY_ROOT],
    ids=lambda unit: unit.name,
)
def test_every_process_is_begun_again_and_may_do_little(unit):
    text = unit.read_text()
    again = (
        unit.with_suffix(".timer").exists()
        if "Type=oneshot" in text
        else re.search("^Restart=always$", text, re.MULTILINE)
    )
    assert again, "what ends is neither restarted nor due again"
    # systemd.unit(5): by default a unit that was started five times within ten seconds is not
    # started any more.
    assert "Type=oneshot" in text or "\nStartLimitIntervalSec=0\n" in text
    assert re.search(r"^(User=telepresence|User=nats|DynamicUser=yes)$", text, re.MULTILINE)
    assert re.search(r"^CapabilityBoundingSet=$", text, re.MULTILINE)


# What makes the most of systemd's own measure, and breaks no program of ours.
HARDENING = (
    "NoNewPrivileges=yes",
    "ProtectSystem=strict",
    "ProtectHome=yes",
    "PrivateTmp=yes",
    "ProtectKernelTunables=yes",
    "ProtectKernelModules=yes",
    "ProtectKernelLogs=yes",
    "ProtectControlGroups=yes",
    "ProtectHostname=yes",
    "ProtectProc=invisible",
    "RestrictNamespaces=yes",
    "RestrictSUIDSGID=yes",
    "LockPersonality=yes",
    "AmbientCapabilities=",
    "SystemCallArchitectures=native",
    "SystemCallFilter=@system-service",
)
MOST_EXPOSED = 3.0  # of 10


@pytest.mark.parametrize(
    "unit", [unit for unit in UNITS if unit.suffix == ".service"], ids=lambda unit: unit.name
)
def test_every_service_is_hardened_also_those_of_root(unit, tmp_path):
    lines = unit.read_text().splitlines()
    assert set(HARDENING) - set(lines) == set()
    assert any(line.startswith("CapabilityBoundingSet=") for line in lines)
    if shutil.which("systemd-analyze") is None:
        return
    plain = tmp_path / unit.name.replace("@.", "@example.")
    shutil.copy(unit, plain)
    code, said = run("systemd-analyze", "security", "--no-pager", "--offline=true", str(plain))
    assert code == 0, said
    (exposure,) = re.findall(r"Overall exposure level for \S+: ([\d.]+)", said)
    assert float(exposure) <= MOST_EXPOSED, said


def test_what_was_kept_long_enough_is_forgotten_once_a_day_also_by_a_computer_that_was_off():
    timer = (DEPLOY / "systemd/telepresence-forget.timer").read_text()
    (calendar,) = re.findall(r"^OnCalendar=(.*)$", timer, re.MULTILINE)
    code, said = run(
        program("systemd-analyze"),
        "calendar",
        "--iterations=3",
        "--base-time=2026-03-01 12:00:00 UTC",
        calendar,
        env={**os.environ, "TZ": "UTC"},
    )
    assert code == 0, said
    days = [
        int(day) for day in re.findall(r"2026-03-(\d\d) \S+ UTC", said.partition("Next elapse")[2])
    ]
    assert days == [2, 3, 4], said
    assert re.search(r"^Persistent=true$", timer, re.MULTILINE)
    assert (
        f"ExecStart={PYTHON} manage.py forget\n"
        in (DEPLOY / "systemd/telepresence-forget.service").read_text()
    )


@pytest.fixture
def machine(tmp_path):
    """A root folder with a certificate of Caddy's and the folders of who needs it; `told` is what
    systemctl was asked for since.
    """
    for name in ("etc/mosquitto/certs", "etc/coturn/certs", "bin"):
        (tmp_path / name).mkdir(parents=True)
    caddys = tmp_path / "var/lib/caddy/.local/share/caddy/certificates/acme/robots.example.org"
    caddys.mkdir(parents=True)
    (tmp_path / "bin/systemctl").write_text(f'#!/bin/sh\necho "$@" >> {tmp_path}/told\n')
    (tmp_path / "bin/systemctl").chmod(0o755)

    class Machine:
        def has_certificate(self, said):
            for suffix in ("crt", "key"):
                (caddys / f"robots.example.org.{suffix}").write_text(f"{said} {suffix}")

        def copy(self, host="robots.example.org"):
            environment = os.environ | {
                "ROOT": str(tmp_path),
                "PATH": f"{tmp_path}/bin:{os.environ['PATH']}",
            }
            code, said = run("sh", DEPLOY / "copy_certificates.sh", host, env=environment)
            told = (tmp_path / "told").read_text() if (tmp_path / "told").exists() else ""
            (tmp_path / "told").unlink(missing_ok=True)
            return code, said, told

        def file(self, name):
            return tmp_path / name

    return Machine()


def test_the_proxys_certificate_is_copied_when_it_is_new_to_those_that_are_there(machine):
    machine.has_certificate("first")
    code, said, told = machine.copy()
    assert code == 0, said
    assert told.splitlines() == [
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


def test_before_the_proxy_has_a_certificate_nobody_is_told_anything(machine):
    code, said, told = machine.copy()
    assert (code, told) == (1, "")
    assert "no certificate of robots.example.org yet" in said


def test_certbots_certificate_is_copied_too(machine):
    live = machine.file("etc/letsencrypt/live/robots.example.org")
    live.mkdir(parents=True)
    (live / "fullchain.pem").write_text("chain")
    (live / "privkey.pem").write_text("key")
    assert machine.copy()[0] == 0
    assert machine.file("etc/mosquitto/certs/privkey.pem").read_text() == "key"


def test_what_a_server_copies_lies_where_its_programs_look_for_it():
    script = (DEPLOY / "copy_certificates.sh").read_text()
    for file in (
        "mosquitto/telepresence.conf",
        "coturn/turnserver.conf",
        "systemd/telepresence-broker.service",
    ):
        folders = set(
            re.findall(r"(/etc/\S+)/(?:fullchain|privkey)\.pem", (DEPLOY / file).read_text())
        )
        assert len(folders) == 1
        assert f"put {folders.pop()}\n" in script


def test_proxies_let_through_what_the_site_takes():
    (caddy,) = re.findall(r"max_size (\d+)MiB", (DEPLOY / "proxy/Caddyfile").read_text())
    (nginx,) = re.findall(
        r"client_max_body_size (\d+)m;", (DEPLOY / "proxy/nginx.conf").read_text()
    )
    assert int(caddy) * 1024 * 1024 == int(nginx) * 1024 * 1024 == MAX_BODY


def test_the_web_unit_starts_daphne_as_the_demo_does():
    text = (DEPLOY / "systemd/telepresence-web@.service").read_text()
    assert f"ExecStart={PYTHON} {' '.join(DAPHNE)} -b 127.0.0.1 -p %i {APPLICATION}\n" in text


@pytest.mark.nightly
def test_units_call_commands_that_exist_with_options_that_they_have():
    for unit in UNITS:
        for command, arguments in re.findall(
            r"manage\.py (\w+)(.*)$", unit.read_text(), re.MULTILINE
        ):
            code, said = run(sys.executable, "manage.py", command, "--help", cwd=ROOT)
            assert code == 0
            assert all(option in said for option in re.findall(r"--[a-z-]+", arguments)), (
                unit.name,
                arguments,
            )


def test_mosquittos_file_has_the_bounds_of_our_own(tmp_path):
    given = (DEPLOY / "mosquitto/telepresence.conf").read_text().splitlines()
    listeners = Listeners("127.0.0.1", 1883, Tls(tmp_path / "c", tmp_path / "k"))
    ours = configuration(listeners, tmp_path).splitlines()
    assert [
        line
        for line in ours
        if line.startswith(("max_", "set_tcp", "autosave", "persistent_client", "allow_anonymous"))
        and line not in given
    ] == []


def test_proxies_and_site_agree_on_what_a_hashed_name_is():
    from telepresence_site.web.static_files import HashedModules

    name = HashedModules(location=str(ROOT / "static")).hashed_name("css/_global.css")
    for file in ("Caddyfile", "nginx.conf"):
        pattern = re.search(r"\^/static/\S+?\$", (DEPLOY / "proxy" / file).read_text())[0]
        assert re.fullmatch(pattern, f"/static/{name}")
        assert not re.fullmatch(pattern, "/static/css/_global.css")
