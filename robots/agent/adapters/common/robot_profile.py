"""A real robot's fixed data, in a TOML file: by its name in profiles/, or by a path with .toml.

series = "giraff"                      how the site calls this kind of robot
driver = "base 2.4"                    software of the base and its version, kept with study drives
footprint = [[0.3, -0.2], …]           convex, metres in the robot's frame
[limits]  [tilt]  [laser]  [camera]  [battery]   as in the factsheet; SI units and radians
[[sonars]]  bumper = true  [depth]     sensors for obstacles, as in robot_interface.py
standstill_linear = 0.02               m/s, and standstill_angular rad/s: no faster is at rest
unguarded_navigation = true            allows navigation that nothing stops when the agent is lost
[moos]  [ros1]  …                      of one adapter; options of the command line overrule it

Each adapter's table states its `watchdog`, the seconds after which the base stops by itself when
velocities no longer come: no adapter has a default, and no option overrules it, because it is a
property of the base. An unknown section or key is an error, also one in the wrong case.
"""

import difflib
import re
import tomllib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args

import msgspec
from msgspec import Meta, Struct

from robots.agent.adapters.common.profile_errors import (
    KeyPath,
    line_of,
    refused,
    shown,
    unreadable,
)
from robots.agent.ramp import check_times
from robots.agent.robot_interface import AdapterError, DepthCamera, Sonar
from robots.api.adapter_names import PROFILES, known_names
from robots.api.messages import Camera, Laser, Limits, Name, Point, TiltRange

FASTEST = {"linear": 5.0, "reverse": 5.0, "angular": 12.0}  # m/s and rad/s, of anything on wheels
WITHOUT_PROFILE = frozenset({"simulator"})  # its robots are data of robots/world
PLACE = re.compile(r"at `\$\.(\w+)")  # of what msgspec complains of
SWITCHES = {"yes": True, "on": True, "no": False, "off": False}  # besides true, false, 1, 0
Settings = TypeVar("Settings", bound=Struct)


class BatteryRange(Struct, frozen=True):
    """Volts of an empty and of a full battery; between them the charge is taken as linear."""

    empty: float
    full: float

    def charge(self, voltage: float) -> float:
        """Return how full a battery with this voltage is, from 0 to 1."""
        return min(1.0, max(0.0, (voltage - self.empty) / (self.full - self.empty)))


# m/s and rad/s: with a larger threshold, a robot that a person sees moving would count as at rest
LARGEST_LINEAR_STANDSTILL = 0.1
LARGEST_ANGULAR_STANDSTILL = 0.3
LinearStandstill = Annotated[float, Meta(gt=0.0, le=LARGEST_LINEAR_STANDSTILL)]
AngularStandstill = Annotated[float, Meta(gt=0.0, le=LARGEST_ANGULAR_STANDSTILL)]
# a section or key of a profile, and the RcaState field that an adapter has to fill for it
ObstacleSensor = Literal["sonars", "bumper", "depth"]


class RobotProfile(Struct, frozen=True):
    """One robot. `adapters` holds the table of each adapter, unchecked; `file` is its path.

    `unguarded_navigation` allows the RCA to navigate where nothing stops it when the agent is lost.
    """

    series: Name
    footprint: tuple[Point, ...]
    limits: Limits
    tilt: TiltRange | None = None
    laser: Laser | None = None
    camera: Camera | None = None
    battery: BatteryRange | None = None
    sonars: tuple[Sonar, ...] = ()
    bumper: bool = False
    depth: DepthCamera | None = None
    unguarded_navigation: bool = False
    standstill_linear: LinearStandstill = 0.02
    standstill_angular: AngularStandstill = 0.05
    driver: Name = ""
    adapters: dict[str, dict[str, Any]] = {}
    file: str = ""


SECTIONS: dict[str, type[Struct]] = {
    "limits": Limits,
    "tilt": TiltRange,
    "laser": Laser,
    "camera": Camera,
    "battery": BatteryRange,
}
# what to tell the owner of a robot whose adapter does not deliver a sensor; {rca} is its name
UNDELIVERED: dict[ObstacleSensor, str] = {
    "sonars": "[[sonars]] cannot be used with {rca}, which delivers no echoes of sonars: remove"
    " these sections",
    "bumper": "bumper = true cannot be used with {rca}, which reports contacts without their"
    " direction: remove it; a contact still stops the robot",
    "depth": "[depth] cannot be used with {rca}, which delivers no points of a depth camera: remove"
    " this section",
}
SHARED = frozenset(RobotProfile.__struct_fields__) - {"adapters", "file"}  # a profile's own keys


def nearest(word: str, known: Collection[str]) -> str:
    """Return the hint after an unknown name: the similar one, or all of them."""
    close = difflib.get_close_matches(word.lower(), known, 1)
    return f"did you mean {close[0]}?" if close else f"there are {', '.join(sorted(known))}"


def load_profile(name: str, folder: Path = PROFILES) -> RobotProfile:
    """Return a robot by its shipped name, such as `giraff`, or by a path that ends in `.toml`.

    `folder` is where an adapter of another package keeps its profiles. Raises AdapterError.
    """
    path = Path(name) if name.endswith(".toml") else folder / f"{name}.toml"
    try:
        return _checked(path)
    except FileNotFoundError as error:
        if name.endswith(".toml"):
            raise AdapterError(f"there is no file {name} with a robot profile") from error
        known = ", ".join(sorted(each.stem for each in folder.glob("*.toml")))
        raise AdapterError(
            f"no robot profile {name!r}: choose one of {known}, or give the path of a .toml file"
        ) from error
    except (OSError, ValueError) as error:
        raise AdapterError(f"the robot profile {path} cannot be used: {error}") from error


def check_sensors(profile: RobotProfile, rca: str, delivered: Collection[ObstacleSensor]) -> None:
    """Raise AdapterError for a sensor in the profile that its adapter does not deliver: the
    collision monitor would wait for it for ever, and an assisted driver would creep or not move.
    """
    for sensor in get_args(ObstacleSensor):
        if getattr(profile, sensor) and sensor not in delivered:
            where = _line_in(profile, (sensor, 0), (sensor,))
            raise AdapterError(where + UNDELIVERED[sensor].format(rca=rca))


def settings_of(
    kind: type[Settings], adapter: str, profile: RobotProfile, options: Mapping[str, Any]
) -> Settings:
    """Return an adapter's settings: its defaults, overruled by the profile's table, overruled by
    the options of this run; a `watchdog` is always the profile's.

    Raises AdapterError, one sentence: an unknown section or option, a wrong value, or no watchdog.
    """
    given = {name.replace("-", "_"): value for name, value in options.items()}
    stated = profile.adapters.get(adapter, {})
    values = {**stated, **given}
    switches = {field.name for field in msgspec.structs.fields(kind) if field.type is bool}
    try:
        _check_names(kind, adapter, profile, [*stated, *given])
        if "watchdog" in kind.__struct_fields__:
            _check_watchdog(adapter, profile, given)
        switched = {
            name: SWITCHES.get(str(values[name]).lower(), values[name])
            for name in switches & values.keys()
        }
        return msgspec.convert(values | switched, kind, strict=False)
    except msgspec.ValidationError as error:
        name, reason = _wrong_value(kind, str(error), values)
        if name in stated and name not in given:
            where = _line_in(profile, (adapter, name))
            raise AdapterError(f"{where}[{adapter}] {name}{reason}") from error
        raise AdapterError(
            f"an option of the adapter {adapter!r} has a wrong value: {name}{reason}"
        ) from error
    except ValueError as error:
        raise AdapterError(str(error)) from error


def _wrong_value(kind: type[Struct], error: str, given: Mapping[str, Any]) -> tuple[str, str]:
    """Return the option that msgspec refuses and what it must be; "" and the error if none."""
    named = PLACE.search(error)
    for field in msgspec.structs.fields(kind):
        if named is not None and field.name == named[1] and field.name in given:
            wanted = _in_words(msgspec.inspect.type_info(field.type))
            found = given[field.name]  # quotes are no fault in an option: only a comma is
            advised = shown(found, wanted if "," in str(found) else "")
            return field.name, f" must be {wanted}, not {advised}"
    return "", error


def _line_in(profile: RobotProfile, *keys: KeyPath) -> str:
    """Return the profile and the line of the first key that it has, the start of a sentence."""
    text = Path(profile.file).read_text(encoding="utf-8") if profile.file else ""
    line = next(filter(None, (line_of(text, key) for key in keys)), "")
    return f"the robot profile {profile.file or profile.series}: {line}"


def _in_words(kind: msgspec.inspect.Type) -> str:
    match kind:
        case msgspec.inspect.IntType(ge=int(least), le=int(most)):
            return f"a whole number from {least} to {most}"
        case msgspec.inspect.IntType():
            return "a whole number"
        case msgspec.inspect.FloatType():
            return "a number"
        case msgspec.inspect.BoolType():
            return "true or false"
        case msgspec.inspect.LiteralType(values=values):
            return f"one of {', '.join(sorted(str(value) for value in values if value))}"
        case msgspec.inspect.UnionType(types=kinds):
            none = msgspec.inspect.NoneType
            return " or ".join(_in_words(each) for each in kinds if not isinstance(each, none))
        case _:
            return "a text"


def _check_names(
    kind: type[Struct], adapter: str, profile: RobotProfile, given: Collection[str]
) -> None:
    # the table of the adapter that is used, and of any that the same robot could be used with
    sections = {*(name for name in known_names() if name not in WITHOUT_PROFILE), adapter}
    for name in profile.adapters:
        if name not in sections:
            raise ValueError(
                f"the profile of {profile.series} has an unknown section [{name}]; "
                f"{nearest(name, sections | SECTIONS.keys())}"
            )
    for name in given:
        if name not in kind.__struct_fields__:
            raise ValueError(
                f"the adapter {adapter!r} has no option {name};"
                f" {nearest(name, kind.__struct_fields__)}"
            )


def _check_watchdog(adapter: str, profile: RobotProfile, options: Mapping[str, Any]) -> None:
    if "watchdog" in options:
        raise ValueError(
            "the watchdog is a property of the base: set it in the profile, in "
            f"the section [{adapter}], not as an option"
        )
    stated = profile.adapters.get(adapter, {})
    if "watchdog" not in stated:
        raise ValueError(
            f"the profile of {profile.series} has no watchdog for {adapter}: set "
            f"in its section [{adapter}] how many seconds the base keeps moving "
            "after the last velocity, then check it with `run_robot NAME --check`"
        )
    if type(stated["watchdog"]) not in {int, float}:
        raise ValueError(
            f"{_line_in(profile, (adapter, 'watchdog'))}[{adapter}] watchdog must be a number, not"
            f" {shown(stated['watchdog'], 'a number')}"
        )
    check_times(stated["watchdog"], profile.limits)


def _checked(path: Path) -> RobotProfile:
    text = path.read_text(encoding="utf-8")
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(unreadable(text, error)) from error
    own = {name: content[name] for name in SHARED & set(content)}
    tables = {name: table for name, table in content.items() if name not in SHARED}
    stray = sorted(name for name, table in tables.items() if not isinstance(table, dict))
    if stray:
        raise ValueError(f"{stray[0]} is not a key of a robot profile; {nearest(stray[0], SHARED)}")
    for name, kind in SECTIONS.items():
        if isinstance(own.get(name), dict):
            own[name] = _section(name, kind, own[name])
    document = {**own, "adapters": tables, "file": str(path)}
    try:
        profile = msgspec.convert(document, RobotProfile)
    except msgspec.ValidationError as error:
        raise ValueError(refused(text, document, error, _snake)) from error
    battery = profile.battery
    if battery is not None and not battery.empty < battery.full:
        raise ValueError("in [battery], empty must be fewer volts than full")
    for name, most in FASTEST.items():
        if (speed := getattr(profile.limits, name)) > most:
            raise ValueError(f"[limits] {name} is {speed:g}; it cannot be more than {most:g}")
    return profile


def _section(name: str, kind: type[Struct], table: dict[str, Any]) -> dict[str, Any]:
    """Return a section with its keys as messages encode them."""
    encoded = {field.name: field.encode_name for field in msgspec.structs.fields(kind)}
    for key in table:
        if key not in encoded:
            raise ValueError(f"[{name}] has no key {key}; {nearest(key, encoded)}")
    return {encoded[key]: value for key, value in table.items()}


def _snake(name: str) -> str:
    return re.sub("([A-Z])", r"_\1", name).lower()
