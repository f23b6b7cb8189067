"""What is fixed about one real robot, in a TOML file: shipped under a name in profiles/, or anywhere as a path that ends in .toml.

series = "giraff"                      how the site calls this kind of robot
footprint = [[0.3, -0.2], …]           convex, metres in the robot's frame
[limits]  [tilt]  [laser]  [camera]  [battery]   as in the factsheet; SI units and radians
[moos]  [ros1]  …                      what one adapter must know about this robot; options of the command line overrule it
"""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from msgspec import Struct

from robots.agent.adapters.contract import AdapterError
from robots.api.messages import Camera, Laser, Limits, Name, Point, TiltRange

SHIPPED = Path(__file__).with_name("profiles")
SHARED = frozenset({"series", "footprint", "limits", "tilt", "laser", "camera", "battery"})
SAID = {"yes": True, "on": True, "no": False, "off": False}  # besides true, false, 1, 0
Settings = TypeVar("Settings", bound=Struct)


class BatteryRange(Struct, frozen=True, forbid_unknown_fields=True):
    """Volts of an empty and of a full battery; between them the charge is taken as linear."""

    empty: float
    full: float

    def charge(self, voltage: float) -> float:
        """Return how full a battery with this voltage is, from 0 to 1."""
        return min(1.0, max(0.0, (voltage - self.empty) / (self.full - self.empty)))


class RobotProfile(Struct, frozen=True):
    """One robot. `adapters` holds the table of each adapter, unchecked."""

    series: Name
    footprint: tuple[Point, ...]
    limits: Limits
    tilt: TiltRange | None = None
    laser: Laser | None = None
    camera: Camera | None = None
    battery: BatteryRange | None = None
    adapters: dict[str, dict[str, Any]] = {}


def load_profile(name: str) -> RobotProfile:
    """Return a robot by its shipped name or by the path of its file.

    Raises:
        AdapterError: no such file, or something in it cannot be; one sentence.
    """
    path = Path(name) if name.endswith(".toml") else SHIPPED / f"{name}.toml"
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        return _checked(content)
    except FileNotFoundError as error:
        known = ", ".join(sorted(each.stem for each in SHIPPED.glob("*.toml")))
        raise AdapterError(f"no robot profile {name!r}; there are {known}, or give the path of a .toml file") from error
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, msgspec.ValidationError, ValueError) as error:
        raise AdapterError(f"the robot profile {path} cannot be used: {error}") from error


def settings_of(kind: type[Settings], adapter: str, profile: RobotProfile, options: Mapping[str, Any]) -> Settings:
    """Return an adapter's settings: its defaults, overruled by the profile's table, overruled by the options of this run.

    Raises:
        AdapterError: an option that the adapter does not have, or one that is not what it should be; one sentence.
    """
    known = kind.__struct_fields__
    given = {**profile.adapters.get(adapter, {}), **{name.replace("-", "_"): value for name, value in options.items()}}
    unknown = sorted(set(given) - set(known))
    if unknown:
        raise AdapterError(f"the adapter {adapter!r} has no option {', '.join(unknown)}; it has {', '.join(known)}")
    switches = {field.name for field in msgspec.structs.fields(kind) if field.type is bool}
    given = {name: SAID.get(str(value).lower(), value) if name in switches else value for name, value in given.items()}
    try:
        return msgspec.convert(given, kind, strict=False)
    except msgspec.ValidationError as error:
        raise AdapterError(f"an option of the adapter {adapter!r} is not what it should be: {error}") from error


def _checked(content: dict[str, Any]) -> RobotProfile:
    own = {name: content[name] for name in SHARED & set(content)}
    tables = {name: table for name, table in content.items() if name not in SHARED}
    stray = sorted(name for name, table in tables.items() if not isinstance(table, dict))
    if stray:
        raise ValueError(f"{stray[0]} is nothing that a profile says")
    for name in ("limits", "tilt", "laser", "camera"):
        if isinstance(own.get(name), dict):
            own[name] = {_camel(key): value for key, value in own[name].items()}
    battery = own.get("battery")
    if isinstance(battery, dict) and not battery.get("empty", 0.0) < battery.get("full", 0.0):
        raise ValueError("an empty battery has fewer volts than a full one")
    return msgspec.convert({**own, "adapters": tables}, RobotProfile)


def _camel(name: str) -> str:
    first, *rest = name.split("_")
    return first + "".join(part.capitalize() for part in rest)
