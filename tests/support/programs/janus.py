"""The real Janus, with the plug-ins that a site uses, on this computer's addresses."""

import os
import socket
import subprocess
import time
from pathlib import Path
from typing import Self

from tests.support.patience import patient
from tests.support.sessions.site import LOOPBACK, free_port

PROGRAM = "/usr/bin/janus"
LIBRARIES = next(Path("/usr/lib").glob("*-linux-gnu/janus"), Path("/usr/lib/janus"))
SECRET = "shared-with-the-site"
USED = {"libjanus_nosip.so", "libjanus_streaming.so", "libjanus_websockets.so"}


def _others(folder: str) -> str:
    found = {path.name for path in (LIBRARIES / folder).glob("*.so")}
    return ",".join(sorted(found - USED))


class Janus:
    """A process that can be killed, stopped and restarted under the same address."""

    def __init__(self, directory: Path, host: str = LOOPBACK) -> None:
        self.directory, self.host, self.port = directory, host, free_port()
        self.url = f"ws://{host}:{self.port}"
        self.process: subprocess.Popen[bytes] | None = None
        directory.mkdir(parents=True, exist_ok=True)
        self._write()

    def _write(self) -> None:
        files = {
            "janus.jcfg": f"""general: {{
                configs_folder = "{self.directory}"
                plugins_folder = "{LIBRARIES / "plugins"}"
                transports_folder = "{LIBRARIES / "transports"}"
                events_folder = "{self.directory}/none"
                loggers_folder = "{self.directory}/none"
                debug_level = 3
                api_secret = "{SECRET}"
            }}
            plugins: {{ disable = "{_others("plugins")}" }}
            transports: {{ disable = "{_others("transports")}" }}""",
            "janus.transport.websockets.jcfg": f"""general: {{
                ws = true
                ws_port = {self.port}
                ws_ip = "{self.host}"
            }}
            admin: {{ admin_ws = false }}""",
            "janus.plugin.nosip.jcfg": f'general: {{ local_ip = "{LOOPBACK}" }}',
            "janus.plugin.streaming.jcfg": "general: {}",
        }
        for name, text in files.items():
            (self.directory / name).write_text(text)

    def start(self) -> Self:
        with (self.directory / "janus.log").open("ab") as log:
            self.process = subprocess.Popen(
                [PROGRAM, "-F", str(self.directory)], stdout=log, stderr=log
            )
        deadline = time.monotonic() + patient(15.0)
        while not self._listens():
            assert self.process.poll() is None, self.log()
            assert time.monotonic() < deadline, self.log()
            time.sleep(0.05)
        return self

    @property
    def pid(self) -> int:
        assert self.process
        return self.process.pid

    def log(self) -> str:
        return (self.directory / "janus.log").read_text(errors="replace")[-2000:]

    def kill(self) -> None:
        assert self.process
        self.process.kill()
        self.process.wait()

    def cpu_seconds(self) -> float:
        assert self.process
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        if self.process is not None and self.process.poll() is None:
            self.kill()

    def _listens(self) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex((self.host, self.port)) == 0
