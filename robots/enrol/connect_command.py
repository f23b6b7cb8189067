"""The command that starts a robot's agent on the robot's computer, ready to paste."""

import ipaddress
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from urllib.parse import urlsplit

from django.utils.functional import Promise
from django.utils.translation import gettext_lazy as _

from robots.api.credentials_file import toml
from robots.enrol.credentials import Credentials
from robots.models import Robot

# The start of each command for a robot's computer, as in README.md.
START = "telepresence run_robot"


@dataclass(frozen=True)
class AskedOption:
    """An option of an adapter that most robots need; left blank, the adapter uses `default`."""

    name: str
    label: str | Promise
    default: str = ""
    choices: tuple[tuple[str, str | Promise], ...] = ()


# By adapter: what the page asks. The adapters have more options, for a robot's profile.
ASKED: Mapping[str, tuple[AskedOption, ...]] = {
    "ros1": (
        AskedOption("master", _("Address of the ROS master"), "http://127.0.0.1:11311"),
        AskedOption("ip", _("Address of the agent's computer in the robot's network"), "127.0.0.1"),
    ),
    "ros2": (
        AskedOption("namespace", _("Namespace"), "/robot1"),
        AskedOption("domain", _("Domain (ROS_DOMAIN_ID)"), "0"),
        AskedOption(
            "on_robot",
            _("Does the agent run on the robot's own computer?"),
            choices=(("", _("Not known")), ("true", _("Yes")), ("false", _("No"))),
        ),
    ),
    "rosbridge": (
        AskedOption("url", _("Address of rosbridge"), "ws://127.0.0.1:9090"),
        AskedOption("version", _("Version of ROS"), choices=(("", "1"), ("2", "2"))),
    ),
    "moos": (
        AskedOption("host", _("Address of the MOOSDB"), "127.0.0.1"),
        AskedOption("port", _("Port of the MOOSDB"), "9000"),
    ),
    "openmora_mqtt": (
        AskedOption("broker", _("Address of the robot's own broker"), "mqtt://127.0.0.1:1883"),
        AskedOption("robot", _("The robot's name in its topics"), "Giraff"),
    ),
}


def connect_command(robot: Robot, server: str, *, file: str = "") -> str:
    """Return the command without a token, or an empty text while adapter or profile are unknown;
    `file` is a credentials file.
    """
    if not (robot.adapter and robot.profile):
        return ""
    words = [robot.name, "--server", server]
    words += ["--credentials", file] if file else []
    words += ["--adapter", robot.adapter, "--profile", robot.profile]
    for name, value in robot.options.items():
        words += ["--option", f"{name}={value}"]
    return f"{START} {shlex.join(words)}"


def credentials_file(robot: Robot, made: Credentials, server: str) -> str:
    """Return the content of a credentials file, with what is known about the robot's kind."""
    kind = {"adapter": robot.adapter, "profile": robot.profile}
    lines = made.toml(server=server, **{name: value for name, value in kind.items() if value})
    return f"{lines}\n[options]\n{toml(robot.options)}" if robot.options else lines


def unreachable(server: str) -> str:
    """Return why no other computer can use the site's address: `loopback`, `plain` (agents send
    credentials over https only), or an empty text.
    """
    parts = urlsplit(server)
    try:
        is_here = ipaddress.ip_address(parts.hostname or "").is_loopback
    except ValueError:
        is_here = parts.hostname == "localhost"
    if is_here:
        return "loopback"
    return "plain" if parts.scheme == "http" else ""
