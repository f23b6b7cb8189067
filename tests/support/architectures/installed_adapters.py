"""Installed packages with adapters: a module, and a dist-info folder with the entry points that
importlib.metadata reads.
"""

from robots.api.adapter_names import GROUP

ADAPTER = """
from robots.agent.adapters.moos.adapter import create as of_moos

def create(profile_name, options):
    return of_moos(profile_name, options)
"""


def install(folder, package, name, *, text=ADAPTER, version="1.0"):
    """Install a package with one adapter of that name into a folder of the import path."""
    module = package.replace("-", "_")
    (folder / f"{module}.py").write_text(text, encoding="utf-8")
    info = folder / f"{module}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n")
    (info / "entry_points.txt").write_text(f"[{GROUP}]\n{name} = {module}\n")
