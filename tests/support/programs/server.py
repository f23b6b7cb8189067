"""A whole server as docs/howto/run-a-server.md builds one: PostgreSQL, Redis, a mosquitto of the
system, the session manager, two web processes, and nginx with TLS in front, with the files of
deploy/. Ports, paths and the certificate are the test's own.
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
    """Make a certificate of our own, for a name, this computer and other addresses; return (key,
    chain).
    """
    names = ",".join([f"DNS:{name}", *(f"IP:{address}" for address in (LOOPBACK, *addresses))])
    key, chain = directory / "privkey.pem", directory / "fullchain.pem"
    subprocess.run(
        [
            "openssl",
            "req",
            "-x509",
            "-newkey",
            "ec",
            "-pkeyopt",
            "ec_paramgen_curve:prime256v1",
            "-nodes",
            "-keyout",
            key,
            "-out",
            chain,
            "-days",
            "2",
            "-subj",
            f"/CN={name}",
            "-addext",
            f"subjectAltName={names}",
        ],
        check=True,
        capture_output=True,
    )
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

    `host` is the name or address that visitors and robots know, `bind` where proxy and broker
    listen for them, `settings` are the site's own.
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
        self.spawn(
            "redis-server",
            "--port",
            str(self.ports["redis"]),
            "--bind",
            LOOPBACK,
            "--save",
            "",
            "--appendonly",
            "no",
        )
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
                return (
                    answer.status,
                    {name.lower(): value for name, value in answer.headers.items()},
                    answer.read().decode(),
                )
        except urllib.error.HTTPError as error:
            return (
                error.code,
                {name.lower(): value for name, value in error.headers.items()},
                error.read().decode(),
            )

    def ready(self, base: str) -> bool:
        try:
            return self.get(f"{base}/readyz")[0] == 200
        except OSError:
            return False

    def figure(self, web: str, line: str) -> float:
        """Return a figure of one web process's /metrics, 0 when it does not stand there."""
        found = re.search(
            rf"^{re.escape(line)} (\S+)$",
            self.get(f"http://{LOOPBACK}:{self.ports[web]}/metrics")[2],
            re.MULTILINE,
        )
        return float(found[1]) if found else 0.0

    # --- the files of deploy/, with the test's ports and paths ---

    def _mosquitto(self, directory: Path) -> Path:
        text = (DEPLOY / "mosquitto/telepresence.conf").read_text()
        text = text.replace("/var/lib/telepresence-mosquitto", str(directory)).replace(
            "listener 1883", f"listener {self.ports['mqtt']}"
        )
        text = text.replace("listener 8883", f"listener {self.ports['mqtts']} {self.bind}")
        text = text.replace("listener 8884", f"listener {self.ports['mqtt-web']}")
        return self._written(
            "mosquitto.conf",
            re.sub(r"/etc/mosquitto/certs/", f"{self.directory}/", text)
            + f"user {getpass.getuser()}\n",
        )

    def _nginx(self) -> Path:
        text = (DEPLOY / "proxy/nginx.conf").read_text()
        for name, path in self.files.items():
            text = text.replace(f"/etc/letsencrypt/live/robots.example.org/{name}", str(path))
        text = re.sub(r"(?m)^\s*listen \[::\].*$", "", text).replace(
            "robots.example.org", self.host
        )
        text = text.replace("listen 80;", f"listen {self.bind}:{self.ports['http']};").replace(
            "listen 443", f"listen {self.bind}:{self.ports['https']}"
        )
        text = text.replace("127.0.0.1:8001", f"{LOOPBACK}:{self.ports['web-0']}").replace(
            "127.0.0.1:8002", f"{LOOPBACK}:{self.ports['web-1']}"
        )
        text = text.replace("127.0.0.1:8884", f"{LOOPBACK}:{self.ports['mqtt-web']}")
        # $host has no port, which a server on 443 does not need.
        text = (
            text.replace("Host $host;", "Host $http_host;")
            .replace("/var/www/telepresence", f"{self.directory}/www")
            .replace("/var/log/nginx", str(self.directory))
        )
        kept = "".join(
            f"{kind}_temp_path {self.directory}/{kind};\n"
            for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
        )
        user = f"user {getpass.getuser()};\n" if getpass.getuser() == "root" else ""
        head = (
            f"{user}worker_processes 1;\npid {self.directory}/nginx.pid;\nerror_log stderr;\nevents"
            " {}\n"
        )
        return self._written(
            "nginx.conf", f"{head}http {{\ninclude /etc/nginx/mime.types;\n{kept}{text}\n}}\n"
        )

    def _written(self, name: str, text: str) -> Path:
        (self.directory / name).write_text(text)
        return self.directory / name


@contextlib.contextmanager
def running_server(directory: Path, **terms: Any) -> Iterator[Server]:
    """A server with everything up, with the given fields of `Server`; ended afterwards."""
    with running_postgres() as postgres:
        server = Server(directory, postgres.url, **terms)
        try:
            server.start()
            yield server
        finally:
            server.stop()
