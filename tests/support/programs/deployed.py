"""The processes of deploy/: systemd's units, the compose files and the Kubernetes manifests, read
into one form.
"""

import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from tests.support.paths import ROOT

DEPLOY = ROOT / "deploy"
KUBERNETES = DEPLOY / "kubernetes"
OURS = {"localhost/telepresence", "telepresence"}  # the images with our processes
WORKLOADS = {"Deployment", "StatefulSet", "DaemonSet", "Job", "CronJob"}


@dataclass(frozen=True)
class Process:
    """One started process: the words of its command, and the document that it is from."""

    name: str
    words: tuple[str, ...]
    image: str = ""
    around: Mapping[str, Any] = field(default_factory=dict)  # the service, container or unit
    pod: Mapping[str, Any] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """Name what runs: a command of manage.py, `daphne`, `robots.agent`, or a program."""
        for before in ("manage.py", "-m"):
            if before in self.words:
                return self.words[self.words.index(before) + 1]
        return self.words[0].rpartition("/")[2] if self.words else ""


def in_words(command: str | list[str]) -> tuple[str, ...]:
    """Return a command's words; of a line for a shell those of the program that it starts."""
    words = shlex.split(command) if isinstance(command, str) else [str(word) for word in command]
    if words[:1] in (["sh"], ["bash"]) and "-c" in words:
        found = re.search(
            r"\b(python manage\.py [\w =/.-]+)|exec ((?:turnserver|redis-server) .+)", words[-1]
        )
        assert found, words
        return tuple((found[1] or found[2]).split())
    return tuple(words)


@cache
def units() -> dict[str, Process]:
    """Return the processes of the units, by the name of the unit."""
    found = {}
    for path in sorted((DEPLOY / "systemd").glob("*.service")):
        text = path.read_text("utf-8")
        (command,) = re.findall(r"^ExecStart=(.+)$", text, re.MULTILINE)
        around = dict(re.findall(r"^(\w+)=(.*)$", text, re.MULTILINE))
        found[path.stem] = Process(path.stem, in_words(command), around=around)
    return found


@cache
def compose(name: str) -> dict[str, Process]:
    services = yaml.safe_load((DEPLOY / name).read_text("utf-8"))["services"]
    return {
        name: Process(name, in_words(service.get("command", "")), service["image"], service)
        for name, service in services.items()
    }


@cache
def kustomization(folder: str) -> dict[str, Any]:
    return yaml.safe_load((KUBERNETES / folder / "kustomization.yaml").read_text("utf-8"))


@cache
def documents(folder: str) -> tuple[dict[str, Any], ...]:
    """Return the manifests of a folder and of its base folders."""
    found: list[dict[str, Any]] = []
    for name in kustomization(folder)["resources"]:
        path = KUBERNETES / folder / name
        if path.is_dir():
            found += documents(str(Path(folder, name)))
        else:
            found += yaml.safe_load_all(path.read_text("utf-8"))
    return tuple(found)


@cache
def pods(folder: str) -> dict[str, dict[str, Any]]:
    """Return the pods of a folder's workloads, by the workload's name."""
    found = {}
    for document in documents(folder):
        if document["kind"] in WORKLOADS:
            spec = document["spec"]
            template = spec["jobTemplate"]["spec"] if document["kind"] == "CronJob" else spec
            found[document["metadata"]["name"]] = template["template"]["spec"]
    return found


@cache
def kubernetes(folder: str) -> list[Process]:
    """Return every container of a folder."""
    return [
        Process(
            f"{workload}/{one['name']}", in_words(one.get("command", "")), one["image"], one, pod
        )
        for workload, pod in pods(folder).items()
        for one in [*pod["containers"], *pod.get("initContainers", [])]
    ]
