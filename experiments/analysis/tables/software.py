"""The programs that computed a report: a paper has to name them."""

import platform
from functools import cache
from importlib.metadata import version

from experiments.analysis.metrics.definitions import VERSION
from experiments.analysis.tables.table import Table
from telepresence import __version__

# Those that compute numbers or draw them. Mixed models and all other tests are computed with SciPy
# and NumPy alone.
LIBRARIES = {"NumPy": "numpy", "SciPy": "scipy", "Matplotlib": "matplotlib"}
PROGRAM = "telepresence"


@cache
def versions() -> dict[str, str]:
    libraries = {title: version(name) for title, name in LIBRARIES.items()}
    ours = {PROGRAM: __version__, f"{PROGRAM}, definitions of the metrics": str(VERSION)}
    return {**ours, "Python": platform.python_version(), **libraries}


def software_table() -> Table:
    title = "Software that computed the tables and figures."
    return Table.of("software", title, ("Software", "Version"), versions().items())
