"""A whole server as docs/howto/run-a-server.md builds one, with the files of deploy/: PostgreSQL,
Redis, the system's Mosquitto, the session manager, two web processes, and nginx with TLS in front.
Ports, paths and the certificate are those of the test.
"""

import contextlib
import getpass
import re
import shutil
import signal
import ssl
import subprocess
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from telepresence_site.serving import APPLICATION, DAPHNE
from tests.support.collected import collected_files
from tests.support.patience import patient
from tests.support.programs.postgres import running_postgres
from tests.support.sessions.site import LOOPBACK, ROOT, Site, free_port, wait_for

DEPLOY = ROOT / "deploy"
PORTS = ("https", "http", "redis", "mqtt", "mqtts", "mqtt-web", "web-0", "web-1")
SECRETS = {"SECRET_KEY": "a-secret-of-the-test-" + "x" * 40, "TURN_SECRET": ""}
MAKE = """
from django.core.management import call_command
from django.utils import timezone
from robots.enrol.credentials import make_credentials
from robots.models import Robot
robot = Robot.objects.create(name="giraff", title="Giraff", returns_home=False)
print(make_credentials(robot, timezone.now()).token)
call_command("mosquitto_files", {directory!r}, verbosity=0, stdout=open("/dev/null", "w"))
"""


def certificate(directory: Path, name: str = "localhost", *addresses: str) -> tuple[Path, Path]:
    """Make a self-signed certificate for a name and addresses; return (key, chain)."""
    names = ",".join([f"DNS:{name}", *(f"IP:{address}" for address in (LOOPBACK, *addresses))])
    key, chain = directory / "privkey.pem", directory / "fullchain.pem"
    words = f"""openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes
        -keyout {key} -out {chain} -days 2 -subj /CN={name} -addext subjectAltName={names}"""
    subprocess.run(words.split(), check=True, capture_output=True)
    return key, chain


def program(name: str) -> str:
    """Return the path of a Debian program; a missing one is an error and never a reason to skip."""
    found = shutil.which(name) or shutil.which(name, path="/usr/sbin")
    assert found, f"{name} is not installed: sh deploy/test_packages.sh"
    return found


@dataclass
class Server:
    """Use with `running_server`. `site` has the Python processes: `session-manager`, `web-0`,
    `web-1`.

    `host` is the public name or address, `bind` where proxy and broker listen, `settings` are those
    of the site.
    """

    directory: Path
    database_url: str
    host: str = "localhost"
    bind: str = LOOPBACK
    settings: dict[str, str] = field(default_factory=dict)
    ports: dict[str, int] = field(default_factory=lambda: {name: free_port() for name in PORTS})
    token: str = ""
    others: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.url = f"https://{self.host}" + (
            "" if self.ports["https"] == 443 else f":{self.ports['https']}"
        )
        key, chain = certificate(self.directory, "localhost", *({self.host} - {"localhost"}))
        self.files = {"privkey.pem": key, "fullchain.pem": chain}
        self.tls = ssl.create_default_context(cafile=str(chain))
        changed = {
            "DATABASE_URL": self.database_url,
            "REDIS_URL": f"redis://{LOOPBACK}:{self.ports['redis']}/0",
            "HTTP_ONLY": "",
            "BEHIND_TLS_PROXY": "1",
            "ALLOWED_HOSTS": f"localhost,127.0.0.1,{self.host}",
            "TRUSTED_PROXIES": LOOPBACK,
            "METRICS_ALLOWED": LOOPBACK,
            "LOG_FORMAT": "json",
            **SECRETS,
            "STATIC_ROOT": str(self.directory / "www" / "static"),
            "MQTT_PUBLIC_URL": f"mqtts://{{host}}:{self.ports['mqtts']}",
            **self.settings,
        }
        self.site = Site(self.directory / "var", mqtt_port=self.ports["mqtt"], settings=changed)

    def start(self) -> None:
        """Start everything, and wait until the proxy says that it is ready."""
        self.site.var.mkdir(exist_ok=True)
        (self.directory / "www").mkdir()
        (self.directory / "www/static").symlink_to(collected_files())
        broker = self.directory / "mosquitto"
        broker.mkdir()
        self.spawn("redis-server", *redis_options(self.ports["redis"], LOOPBACK))
        self.token = self.site.django(MAKE.format(directory=str(broker))).strip()
        self.spawn("mosquitto", "-c", str(self._mosquitto(broker)))
        self.site.start("session-manager", ["manage.py", "run_session_manager"])
        for name in ("web-0", "web-1"):
            self.site.start(
                name, [*DAPHNE, "-b", LOOPBACK, "-p", str(self.ports[name]), APPLICATION]
            )
        self.spawn(
            "nginx", "-p", str(self.directory), "-c", str(self._nginx()), "-g", "daemon off;"
        )
        for name in ("web-0", "web-1"):
            wait_for(
                lambda name=name: self.ready(f"http://{LOOPBACK}:{self.ports[name]}"),
                60,
                f"{name} with all its parts",
            )
        wait_for(lambda: self.ready(self.url), 20, "the proxy")

    def spawn(self, name: str, *arguments: str) -> None:
        with (self.directory / f"{name}.log").open("wb") as log:
            self.others.append(
                subprocess.Popen([program(name), *arguments], stdout=log, stderr=subprocess.STDOUT)
            )

    def stop(self) -> None:
        for name in self.site.processes:  # all of them at once
            self.site.send(name, signal.SIGTERM)
        with contextlib.ExitStack() as stack:
            for process in self.others:  # the proxy ends first, the last of these
                stack.callback(process.wait, patient(10))
                stack.callback(process.send_signal, signal.SIGTERM)
            stack.callback(self.site.stop_all)

    def get(self, url: str, **headers: str) -> tuple[int, dict[str, str], str]:
        """Return (status, headers, text)."""
        try:
            with urllib.request.urlopen(
                urllib.request.Request(url, headers=headers), timeout=patient(5), context=self.tls
            ) as answer:
                return _parts(answer)
        except urllib.error.HTTPError as error:
            return _parts(error)

    def ready(self, base: str) -> bool:
        try:
            return self.get(f"{base}/readyz")[0] == 200
        except OSError:
            return False

    def figure(self, web: str, line: str) -> float:
        """Return a figure of one web process's /metrics, 0 when it is missing there."""
        metrics = self.get(f"http://{LOOPBACK}:{self.ports[web]}/metrics")[2]
        found = re.search(rf"^{re.escape(line)} (\S+)$", metrics, re.MULTILINE)
        return float(found[1]) if found else 0.0

    # --- the files of deploy/, with the test's ports and paths ---

    def _mosquitto(self, directory: Path) -> Path:
        changes = {
            "/var/lib/telepresence-mosquitto": str(directory),
            "listener 1883": f"listener {self.ports['mqtt']}",
            "listener 8883": f"listener {self.ports['mqtts']} {self.bind}",
            "listener 8884": f"listener {self.ports['mqtt-web']}",
            "/etc/mosquitto/certs/": f"{self.directory}/",
        }
        text = _changed(DEPLOY / "mosquitto/telepresence.conf", changes)
        return self._written("mosquitto.conf", f"{text}user {getpass.getuser()}\n")

    def _nginx(self) -> Path:
        certificates = "/etc/letsencrypt/live/robots.example.org"
        changes = {
            **{f"{certificates}/{name}": str(path) for name, path in self.files.items()},
            "robots.example.org": self.host,
            "listen 80;": f"listen {self.bind}:{self.ports['http']};",
            "listen 443": f"listen {self.bind}:{self.ports['https']}",
            "127.0.0.1:8001": f"{LOOPBACK}:{self.ports['web-0']}",
            "127.0.0.1:8002": f"{LOOPBACK}:{self.ports['web-1']}",
            "127.0.0.1:8884": f"{LOOPBACK}:{self.ports['mqtt-web']}",
            # $host has no port, which a server on 443 does not need.
            "Host $host;": "Host $http_host;",
            "/var/www/telepresence": f"{self.directory}/www",
            "/var/log/nginx": str(self.directory),
        }
        text = _changed(DEPLOY / "proxy/nginx.conf", changes)
        text = re.sub(r"(?m)^\s*listen \[::\].*$", "", text)
        kept = "".join(
            f"{kind}_temp_path {self.directory}/{kind};\n"
            for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
        )
        user = f"user {getpass.getuser()};\n" if getpass.getuser() == "root" else ""
        head = f"{user}worker_processes 1;\npid {self.directory}/nginx.pid;\nerror_log stderr;\n"
        http = f"http {{\ninclude /etc/nginx/mime.types;\n{kept}{text}\n}}\n"
        return self._written("nginx.conf", f"{head}events {{}}\n{http}")

    def _written(self, name: str, text: str) -> Path:
        (self.directory / name).write_text(text)
        return self.directory / name


def redis_options(port: int, host: str) -> tuple[str, ...]:
    """Return the options of a Redis that keeps nothing."""
    kept = ("--save", "", "--appendonly", "no")
    return ("--port", str(port), "--bind", host, "--protected-mode", "no", *kept)


def _changed(path: Path, changes: dict[str, str]) -> str:
    text = path.read_text()
    for old, new in changes.items():
        text = text.replace(old, new)
    return text


def _parts(answer: Any) -> tuple[int, dict[str, str], str]:
    headers = {name.lower(): value for name, value in answer.headers.items()}
    return answer.status, headers, answer.read().decode()


@contextlib.contextmanager
def web_alone(var: Path) -> Iterator[Site]:
    """Run a site with a web server and nothing else."""
    site = Site(var)
    try:
        site.prepare()
        site.start_web()
        wait_for(lambda: site.listening(site.web_port), 60, "the web server")
        yield site
    finally:
        site.stop_all()


@contextlib.contextmanager
def running_server(directory: Path, **terms: Any) -> Iterator[Server]:
    """Run a server with all its parts, with the given fields of `Server`."""
    with running_postgres() as postgres:
        server = Server(directory, postgres.url, **terms)
        try:
            server.start()
            yield server
        finally:
            server.stop()
