"""Finds an adapter by its name: ours, one of an installed package, or any file or module that has
`create(profile_name, options)`.
"""

import importlib
import importlib.util
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, cast

from robots.agent.adapters.navigation_layer.adapter import wrapped
from robots.agent.autonomy.area import update_of
from robots.agent.ramp import check_times
from robots.agent.robot_interface import Adapter, AdapterError
from robots.api.adapter_names import (
    GROUP,
    OURS,
    AmbiguousAdapterError,
    installed,
    known_names,
    package_of,
)
from robots.world.sites import SiteError, load_site

WITHOUT_SCIPY = "SciPy is missing: install it with pip install 'telepresence[navigation]'"


def create(
    adapter_name: str, profile_name: str, options: Mapping[str, Any] | None = None
) -> Adapter:
    """Return an adapter, not connected yet.

    Args:
        adapter_name: one of ours, an entry point of an installed package, the path of a `.py` file,
            or the dotted name of a module.
        profile_name: which robot, such as `giraff`.
        options: the adapter's own; its module lists them.

    Raises AdapterError, one sentence: no such adapter, profile or option, a name that two packages
    use, or a missing dependency of the adapter.
    """
    try:
        module = _module(adapter_name)
    except AmbiguousAdapterError as error:
        raise AdapterError(str(error)) from error
    except (ImportError, AttributeError, OSError, SyntaxError) as error:
        reason = WITHOUT_SCIPY if getattr(error, "name", "") == "scipy" else error
        raise AdapterError(f"the adapter {adapter_name!r} cannot be loaded: {reason}") from error
    if not hasattr(module, "create"):
        raise AdapterError(f"the adapter {adapter_name!r} has no create(profile_name, options)")
    adapter = cast("Adapter", module.create(profile_name, options or {}))
    if not adapter.profile.watchdog > 0.0:
        raise AdapterError(
            f"the adapter {adapter_name!r} has no watchdog: nothing would stop "
            "the base if the agent died"
        )
    try:
        check_times(adapter.profile.watchdog, adapter.profile.limits)
    except ValueError as error:
        raise AdapterError(
            f"the robot {profile_name!r} cannot be driven safely: {error}"
        ) from error
    return adapter


def version_of(adapter_name: str, own: str) -> str:
    """Return an adapter's name with the version of its package, `own` for ours, none for a file."""
    if adapter_name in OURS:
        return f"{adapter_name} {own}"
    point = installed().get(adapter_name)
    return (package_of(point) if point is not None else Path(adapter_name).name)[:120]


def _module(name: str) -> ModuleType:
    if name.endswith(".py"):
        spec = importlib.util.spec_from_file_location(Path(name).stem, name)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module
    if name in OURS:
        return importlib.import_module(OURS[name])
    names = known_names()
    if name in names:
        return cast("ModuleType", installed()[name].load())
    if "." in name:
        return importlib.import_module(name)
    raise AdapterError(
        f"no adapter {name!r}; there are {', '.join(names)}. Install a "
        f"package that provides it (entry point group {GROUP!r}), or give the "
        "path of a .py file"
    )


def autonomous(adapter: Adapter, plan: str = "", memory: Path | None = None) -> Adapter:
    """Return the adapter with the localization and the navigation that it lacks, when it has a
    laser.

    `plan` is the robot's site, a shipped name or a folder; the default is the adapter's, else the
    server's. `memory` is the file of the robot's last pose. Raises AdapterError when the site
    cannot be used, or SciPy is missing.
    """
    name = plan or adapter.profile.plan
    try:
        found = wrapped(adapter, update_of(load_site(name)) if name else None, memory)
    except SiteError as error:
        raise AdapterError(f"--plan: {error}" if plan else str(error)) from error
    if found is not adapter and importlib.util.find_spec("scipy") is None:
        raise AdapterError(f"the agent must navigate this robot: {WITHOUT_SCIPY}")
    return found
