"""The JavaScript modules of a page: its entry, and all static imports, direct and indirect.

Dynamic imports (`import("./panel.js")`) are not needed at once; see `later_modules_of`.
"""

import re
from functools import lru_cache
from posixpath import dirname, join, normpath

from django.conf import settings

IMPORT = re.compile(r"""^(?:import|export)\b[^"';]*"(\.[^"]+)";""", re.MULTILINE)
LATER = re.compile(r"""import\("(\.[^"]+)"\)\)""")  # not `import("./x.js").Type` in a comment


def imports_of(name: str) -> list[str]:
    """Return the static imports of a module; names are paths under static/: `js/lib/ids.js`."""
    return _targets(IMPORT, name)


def _targets(pattern: re.Pattern[str], name: str) -> list[str]:
    source = (settings.BASE_DIR / "static" / name).read_text()
    return [normpath(join(dirname(name), target)) for target in pattern.findall(source)]


def modules_of(entry: str) -> tuple[str, ...]:
    """Return an entry and all that it imports, in the order in which a browser finds them."""
    return _walk(entry) if settings.DEBUG else _kept(entry)


def later_modules_of(importer: str, beside: str) -> tuple[str, ...]:
    """Return what a module imports dynamically, with all static imports of that, but without the
    modules of the entry `beside`.
    """
    loaded = set(modules_of(beside))
    found = dict.fromkeys(name for entry in _targets(LATER, importer) for name in modules_of(entry))
    return tuple(name for name in found if name not in loaded)


def _walk(entry: str) -> tuple[str, ...]:
    found = {entry: None}
    for name in (queue := [entry]):
        new = [target for target in imports_of(name) if target not in found]
        found.update(dict.fromkeys(new))
        queue.extend(dict.fromkeys(new))
    return tuple(found)


_kept = lru_cache(_walk)
