"""`make bench`: every benchmark, one after the other, each in a process of its own so that none
warms the next one up. `python -m benchmarks NAME …` runs some, by the names of their files.
"""

import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parent
BENCHMARKS = (
    *("media", "audience", "control", "page_floods", "visits", "relay", "states", "load", "idle"),
    *("crashes", "floods", "page", "narrow", "links", "networks", "cockpit", "robot", "camera"),
    *("localization", "navigation", "docking", "assist", "autonomy", "replay", "analysis"),
    *("export", "markers"),
)


def module_of(name: str) -> str:
    """Return the module of a benchmark; SystemExit if there is none."""
    path = next(FOLDER.rglob(f"{name}.py"), None)
    if path is None:
        raise SystemExit(f"There is no benchmark {name}.")
    return ".".join((FOLDER.name, *path.relative_to(FOLDER).with_suffix("").parts))


def main() -> int:
    modules = {name: module_of(name) for name in sys.argv[1:] or BENCHMARKS}
    failed = [
        name
        for name, module in modules.items()
        if subprocess.run([sys.executable, "-m", module], check=False).returncode
    ]
    if failed:
        print("failed:", ", ".join(failed))
    return len(failed)


if __name__ == "__main__":
    sys.exit(main())
