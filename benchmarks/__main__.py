"""`make bench`: every benchmark, one after the other, each in a process of its own so that none
warms the next one up.
"""

import subprocess
import sys

BENCHMARKS = (
    "media",
    "control",
    "page_floods",
    "relay",
    "states",
    "load",
    "crashes",
    "floods",
    "page",
    "narrow",
    "networks",
    "cockpit",
    "robot",
    "camera",
    "localization",
    "navigation",
    "docking",
    "assist",
    "autonomy",
    "replay",
    "analysis",
    "export",
)


def main() -> int:
    """Run the benchmarks named on the command line, or all of them, and return how many failed."""
    names = sys.argv[1:] or BENCHMARKS
    failed = [
        name
        for name in names
        if subprocess.run([sys.executable, "-m", f"benchmarks.{name}"], check=False).returncode
    ]
    if failed:
        print("failed:", ", ".join(failed))
    return len(failed)


if __name__ == "__main__":
    sys.exit(main())
