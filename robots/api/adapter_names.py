"""The names of adapters, as on an agent's command line, in its credentials file, in the profile of
a robot, and in the administration.

Ours are listed here. Other Python packages declare theirs as entry points of `GROUP`, each a module
with `create(profile_name, options)`:

    [project.entry-points."telepresence.adapters"]
    acme = "telepresence_acme.adapter"

Listing the names imports no adapter, so that the server can do it, too. On the robot's computer,
where the agent runs, other adapters may be installed than on the server.

    https://packaging.python.org/en/latest/specifications/entry-points/
"""

from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

import structlog

log = structlog.stdlib.get_logger(__name__)

GROUP = "telepresence.adapters"
PROFILES = Path(__file__).parents[1] / "agent" / "adapters" / "profiles"  # ours, as .toml files
OURS: Mapping[str, str] = {
    "simulator": "robots.agent.adapters.simulator.adapter",
    "moos": "robots.agent.adapters.moos.adapter",
    "openmora_mqtt": "robots.agent.adapters.moos.openmora_mqtt",
    "ros1": "robots.agent.adapters.ros.ros1",
    "ros2": "robots.agent.adapters.ros.ros2",
    "rosbridge": "robots.agent.adapters.ros.rosbridge",
}


class AmbiguousAdapterError(ValueError):
    """Two packages use the same name for different adapters; the message is one sentence."""


def installed() -> dict[str, EntryPoint]:
    """Return the adapters of other packages that are installed here, by name.

    One with a name of ours is left out, with a warning.

    Raises:
        AmbiguousAdapterError: two packages use one name.
    """
    found: dict[str, EntryPoint] = {}
    for point in entry_points(group=GROUP):
        if point.name in OURS:
            log.warning("adapter_name_taken", name=point.name, package=package_of(point))
            continue
        other = found.setdefault(point.name, point)
        if other.value != point.value:
            raise AmbiguousAdapterError(
                f"two installed packages provide the adapter {point.name!r}: "
                f"{package_of(other)} and {package_of(point)}; uninstall one of them"
            )
    return found


def package_of(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist is not None else point.value


def known_names() -> tuple[str, ...]:
    """Return all names of adapters here, ours and those of installed packages.

    Raises:
        AmbiguousAdapterError: two packages use one name.
    """
    return tuple(sorted({*OURS, *installed()}))


def profile_names() -> tuple[str, ...]:
    """Return the names of our robot profiles."""
    return tuple(sorted(path.stem for path in PROFILES.glob("*.toml")))
