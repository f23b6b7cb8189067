"""The command `telepresence`, or `python -m telepresence`: a robot's agent, and the commands of
manage.py.

In a wheel, all other folders of the project are in `_tree`, and this puts them on the path of its
process. Children are started with the path of manage.py, or in that folder.
"""

import os
import sys
from pathlib import Path

from telepresence import __version__

PACKAGE = Path(__file__).resolve().parent
IS_INSTALLED = (PACKAGE / "_tree").is_dir()
TREE = PACKAGE / "_tree" if IS_INSTALLED else PACKAGE.parent
EXTRA_WITH = {
    "django": "site",
    "matplotlib": "analysis",
    "pandas": "analysis",
    "pyreadstat": "analysis",
    "statsmodels": "analysis",
    "pylsl": "lsl",
}


def data_folder() -> Path:
    """Return where VAR_DIR is unless it is set: the clone's, or the user's own for an installed
    wheel, whatever the current folder.
    """
    if not IS_INSTALLED:
        return TREE / "var"
    usual = Path.home() / ".local" / "share"
    named = os.environ.get("XDG_DATA_HOME") or os.environ.get("LOCALAPPDATA")
    return Path(named or usual).absolute() / "telepresence"


def main() -> int:
    """Run a command and return its exit code."""
    arguments = sys.argv[1:]
    if arguments in (["version"], ["--version"]):
        print(__version__)
        return 0
    sys.path.insert(0, str(TREE))
    os.environ["VAR_DIR"] = str(Path(os.environ.get("VAR_DIR") or data_folder()).absolute())
    if arguments[:1] == ["run_robot"]:
        return _run_robot(arguments[1:])
    try:
        return _manage()
    except ModuleNotFoundError as error:
        extra = EXTRA_WITH.get((error.name or "").partition(".")[0])
        if extra is None:
            raise
        sys.stderr.write(
            f"This needs {error.name}: install it with pip install 'telepresence[{extra}]'.\n"
        )
        return 1


def _run_robot(arguments: list[str]) -> int:
    """Run the agent without Django, which a robot's computer does not need."""
    from robots.agent.agent import main as run  # noqa: PLC0415 -- found in TREE

    os.environ["TELEPRESENCE_VAR"] = os.environ.get("TELEPRESENCE_VAR") or os.environ["VAR_DIR"]
    return run(arguments, program="telepresence run_robot")


def _manage() -> int:
    from manage import main as manage  # noqa: PLC0415 -- found in TREE

    manage()
    return 0


if __name__ == "__main__":
    sys.exit(main())
