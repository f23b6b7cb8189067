"""An agent's settings: from command line, environment, or a credentials file, in this order.

A credentials file is TOML as the site provides it: `robot`, `token`, and where to reach the server
(`server`, or the broker itself as `mqtt_url`); it may also name `ca`, `adapter`, `profile`, `plan`
and a table of `options`.
"""

import argparse
import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from robots.agent.lab.in_force import CLEAN, Networks
from robots.api import network_words
from robots.api.adapter_names import OURS, AmbiguousAdapterError, known_names
from robots.api.credentials_file import ENVIRONMENT
from robots.api.messages import NetworkLab
from robots.api.topics import RESERVED_NAMES, ROBOT_NAME

DEVICES = ("camera", "microphone", "loudspeaker")
SETTINGS = ("server", "mqtt_url", "token", "ca", "adapter", "profile", "plan", "viewers", "user")
TEXT: tuple[tuple[type, ...], str] = ((str,), "a text in quotes")
# settings of a credentials file other than texts: types, and their name in a sentence
KINDS: dict[str, tuple[tuple[type, ...], str]] = {
    "viewers": ((int, str), "a whole number"),
    "options": ((dict,), "a table"),
}
DEFAULT_ADAPTER = "simulator"
DEFAULT_VIEWERS = 8
MOST_VIEWERS = 64
LARGEST_SEED = 2**31 - 1


class ConfigError(ValueError):
    """A wrong setting; one sentence for the robot's owner."""


@dataclass(frozen=True)
class AgentConfig:
    """Settings of one agent: one of `server` and `mqtt_url`; `var` survives restarts."""

    robot: str
    server: str | None
    mqtt_url: str | None
    token: str | None = field(repr=False)
    ca: str | None
    adapter: str
    profile: str
    options: dict[str, Any]
    viewers: int
    var: Path
    clear_estop: bool = False
    plan: str = ""
    networks: Networks = CLEAN
    # at the broker; the robot's name unless the server gave another one with the credentials
    user: str = ""
    credentials: Path | None = None  # the file that they came from
    camera: str = ""  # devices as devices.device_address has them; empty is what the adapter has
    microphone: str = ""
    loudspeaker: str = ""


SOUND = "such as alsa:default,"
CAMERAS = "such as /dev/video0, rtsp://host/stream, a file,"
NO_SITE = """no site is known for the robot {robot}. What to do next:
  The site is running, here or elsewhere: on its machine run
      manage.py enrol {robot} --server https://ADDRESS-OF-THE-SITE
    and then, on this machine, the command that it prints.
  You have credentials already: add --credentials FILE, or --mqtt mqtt://HOST for a broker alone.
  There is no site yet: `telepresence demo`, in a clone `make demo`, starts one on this machine.
  You want to test the robot without a site: add --adapter NAME --check."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `run_robot` and `python -m robots.agent`."""
    parser.add_argument("robot", help="the robot's name on the site")
    _add_server(parser)
    _add_robot(parser)
    _add_media(parser)
    parser.add_argument(
        "--var",
        metavar="DIR",
        type=Path,
        help="where the agent stores an emergency stop across restarts (default: var)",
    )
    _add_network_lab(parser)
    parser.add_argument(
        "--check",
        action="store_true",
        help="test the robot with its wheels off the ground, measure its watchdog, and exit",
    )
    parser.add_argument(
        "--yes",
        action="store_true",
        help="with --check: confirm that its wheels are off the ground, without being asked",
    )
    parser.add_argument(
        "--clear-estop",
        action="store_true",
        help="release a latched emergency stop; use it only next to the robot",
    )


def _add_server(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--server", metavar="URL", help="the site's address; the site names the broker"
    )
    parser.add_argument(
        "--mqtt",
        metavar="URL",
        dest="mqtt_url",
        help="the broker's own address: mqtt://, mqtts://, ws:// or wss://host:port",
    )
    parser.add_argument(
        "--credentials",
        metavar="FILE",
        type=Path,
        help="TOML file with robot and token (default: credentials/ROBOT.toml in --var)",
    )
    parser.add_argument(
        "--enrol",
        metavar="TOKEN",
        help="a one-time token: fetch the credentials from --server, save them in that file, and"
        " start",
    )
    parser.add_argument(
        "--ca",
        metavar="FILE",
        help="certificates to trust besides the system's, for a self-signed one",
    )


def _add_robot(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--adapter",
        help=f"the robot control architecture: {', '.join(sorted(OURS))}, the name of an adapter"
        f" from an installed package, or a .py file (default without --server: {DEFAULT_ADAPTER})",
    )
    parser.add_argument("--profile", help="the robot's profile (default: the robot's name)")
    parser.add_argument(
        "--plan",
        help="the site in which the robot navigates: a shipped one or a folder (default: what the"
        " server sends)",
    )
    parser.add_argument(
        "--option",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="an option of the adapter; may be repeated",
    )


def _add_media(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--viewers", type=int, help=f"how many pages may watch at once (default: {DEFAULT_VIEWERS})"
    )
    for device, examples in zip(DEVICES, (CAMERAS, SOUND, SOUND), strict=True):
        text = f"{examples} or none (default: the adapter's own)"
        parser.add_argument(f"--{device}", metavar="DEVICE", help=text)


def _add_network_lab(parser: argparse.ArgumentParser) -> None:
    lab = (
        f"make the driver's network worse, such as {network_words.EXAMPLE},rate=400: ms, %%, kbit/s"
    )
    parser.add_argument(
        "--control-network", metavar="WORDS", help=f"{lab}; for commands sent to the robot"
    )
    parser.add_argument(
        "--video-network",
        metavar="WORDS",
        help="the same for video and sound sent to the driver",
    )
    parser.add_argument(
        "--network-seed", metavar="N", default="0", help="random seed for both (default: 0)"
    )


def load(
    arguments: Mapping[str, Any],
    environment: Mapping[str, str] | None = None,
    *,
    enrolling: bool = False,
    checking: bool = False,
) -> AgentConfig:
    """Return the configuration of command line, environment and credentials file.

    While `enrolling`, credentials are neither required nor read from the file that they will
    replace. With `checking` no site is required, but an adapter is. `environment` is the process's
    by default. Raises ConfigError for a missing, contradictory or unreadable setting.
    """
    environment = os.environ if environment is None else environment
    robot = _checked_name(str(arguments["robot"]))
    var = Path(arguments.get("var") or environment.get(f"{ENVIRONMENT}VAR") or "var")
    path = credentials_path(arguments, environment)
    kept: dict[str, Any] = {}
    if not enrolling:
        kept = _credentials(path, named=path != _usual_path(var, robot), robot=robot)

    def setting(name: str) -> Any:
        values = arguments.get(name), environment.get(ENVIRONMENT + name.upper()), kept.get(name)
        return next((value for value in values if value is not None and value != ""), None)

    found = {name: setting(name) for name in (*SETTINGS, *DEVICES)}
    if not checking:
        _check_addresses(arguments, found, enrolling=enrolling)
    _check_adapter(found, enrolling=enrolling or checking)
    by_server = found["server"] and not found["mqtt_url"]
    return AgentConfig(
        robot=robot,
        server=str(found["server"]).rstrip("/") if by_server else None,
        mqtt_url=found["mqtt_url"],
        token=found["token"],
        ca=found["ca"],
        adapter=found["adapter"] or DEFAULT_ADAPTER,
        profile=found["profile"] or robot,
        options={**kept.get("options", {}), **_options(arguments.get("option") or [])},
        viewers=_viewers(found["viewers"]),
        var=var,
        clear_estop=bool(arguments.get("clear_estop")),
        plan=str(found["plan"] or ""),
        networks=_networks(arguments),
        user=str(found["user"] or robot),
        credentials=path if kept.get("token") and kept["token"] == found["token"] else None,
        **{device: str(found[device] or "") for device in DEVICES},
    )


def _checked_name(robot: str) -> str:
    if not ROBOT_NAME.match(robot) or robot in RESERVED_NAMES:
        wanted = "use lower-case letters, digits and hyphens"
        raise ConfigError(f"{robot!r} is not a valid robot name, or is reserved: {wanted}")
    return robot


def credentials_path(
    arguments: Mapping[str, Any], environment: Mapping[str, str] | None = None
) -> Path:
    """Return where the credentials are: the named file, or the site's own folder for them."""
    environment = os.environ if environment is None else environment
    var = Path(arguments.get("var") or environment.get(f"{ENVIRONMENT}VAR") or "var")
    named = arguments.get("credentials") or environment.get(f"{ENVIRONMENT}CREDENTIALS")
    return Path(named) if named else _usual_path(var, str(arguments["robot"]))


def _usual_path(var: Path, robot: str) -> Path:
    return var / "credentials" / f"{robot}.toml"


def _credentials(path: Path, *, named: bool, robot: str) -> dict[str, Any]:
    """Read a credentials file; it may be missing unless it was named."""
    if not named and not path.exists():
        return {}
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        reason = error.strerror or error
        raise ConfigError(f"the credentials file {path} cannot be read: {reason}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"the credentials file {path} is not valid TOML: {error}") from error
    if content.get("robot", robot) != robot:
        raise ConfigError(
            f"the credentials file {path} is for the robot {content['robot']!r}, not for {robot!r}"
        )
    for name in (*SETTINGS, *DEVICES, "options"):
        kinds, expected = KINDS.get(name, TEXT)
        if name in content and type(content[name]) not in kinds:
            raise ConfigError(
                f"in the credentials file {path}, {name} has the wrong type: it must be {expected}"
            )
    return content


def _check_addresses(
    arguments: Mapping[str, Any], found: dict[str, Any], *, enrolling: bool
) -> None:
    if arguments.get("server") and arguments.get("mqtt_url"):
        raise ConfigError("give --server or --mqtt, not both: the server names its broker")
    if arguments.get("server"):
        found["mqtt_url"] = None  # what the command line says overrules the file
    if not found["server"] and not found["mqtt_url"]:
        raise ConfigError(NO_SITE.format(robot=arguments["robot"]))
    if not found["mqtt_url"]:
        if not _is_site(str(found["server"])):
            raise ConfigError(
                "the server's address (--server, TELEPRESENCE_SERVER, or server in the credentials"
                " file) must begin with https:// or http:// and name a host, such as"
                f" https://robots.example.org, not {found['server']!r}"
            )
        _check_token(found)
        if not found["token"] and not enrolling:
            raise ConfigError(
                "the server requires credentials: give --credentials FILE, which it provides when"
                " you create them"
            )


def _is_site(address: str) -> bool:
    try:
        parts = urlsplit(address)
        is_whole = bool(parts.hostname) and parts.port != 0 and len(address.split()) == 1
    except ValueError:
        return False
    return parts.scheme in {"https", "http"} and is_whole


def _check_token(found: Mapping[str, Any]) -> None:
    """Refuse what cannot be a token, because it would be sent in a request's header and logged."""
    token = str(found["token"] or "")
    if not (token.isascii() and token.isprintable()) or " " in token:
        raise ConfigError(
            "the robot's token (TELEPRESENCE_TOKEN, or token in the credentials file) contains"
            " spaces, line breaks or other characters that never occur in one: copy it again"
        )


def _check_adapter(found: Mapping[str, Any], *, enrolling: bool) -> None:
    """Require a name: a simulated robot must never replace a real one by mistake."""
    if not found["adapter"] and (enrolling or not found["mqtt_url"]):
        raise ConfigError(
            f"no adapter is given: add --adapter ({', '.join(_adapter_names())}, or a .py file)"
        )


def _adapter_names() -> tuple[str, ...]:
    try:
        return known_names()
    except AmbiguousAdapterError as error:
        raise ConfigError(str(error)) from error


def _options(given: list[str]) -> dict[str, str]:
    pairs = [text.partition("=") for text in given]
    for text, (name, equals, _) in zip(given, pairs, strict=True):
        if not (name and equals):
            raise ConfigError(f"--option needs NAME=VALUE, not {text!r}")
    return {name: value for name, _, value in pairs}


def _networks(arguments: Mapping[str, Any]) -> Networks:
    """Return the drivers' networks; the video's seed is the next one, as in a study."""
    text = str(arguments.get("network_seed") or "0")
    if not (text.isdecimal() and int(text) <= LARGEST_SEED):
        raise ConfigError(
            f"--network-seed must be a whole number from 0 to {LARGEST_SEED}, not {text!r}"
        )
    seed = int(text)
    control = _network("--control-network", arguments.get("control_network"), seed)
    return Networks(control, _network("--video-network", arguments.get("video_network"), seed + 1))


def _network(option: str, words: Any, seed: int) -> NetworkLab | None:
    try:
        return network_words.parse(str(words), seed) if words else None
    except ValueError as error:
        raise ConfigError(f"{option}: {error}") from error


def _viewers(value: Any) -> int:
    try:
        viewers = int(DEFAULT_VIEWERS if value is None else value)
    except ValueError:
        viewers = -1
    if not 0 <= viewers <= MOST_VIEWERS:
        raise ConfigError(
            "the number of viewers (--viewers, TELEPRESENCE_VIEWERS, or viewers in the credentials"
            f" file) must be between 0 and {MOST_VIEWERS}, not {value!r}"
        )
    return viewers
