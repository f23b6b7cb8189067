"""Which JavaScript modules a page needs: the imports of its entry, and of what that imports.

Only static imports count. What is imported when it is needed (`import("./panel.js")`) is not
needed at once.
"""

import re
from functools import lru_cache
from posixpath import dirname, join, normpath

from django.conf import settings

IMPORT = re.compile(r"""^(?:import|export)\b[^"';]*"(\.[^"]+)";""", re.MULTILINE)


def imports_of(name: str) -> list[str]:
    """Return what a module imports; all names are paths under static/, such as `js/lib/ids.js`."""
    source = (settings.BASE_DIR / "static" / name).read_text()
    return [normpath(join(dirname(name), target)) for target in IMPORT.findall(source)]


def modules_of(entry: str) -> tuple[str, ...]:
    """Return an entry and all that it imports, in the order in which a browser finds them."""
    return _walk(entry) if settings.DEBUG else _kept(entry)


def _walk(entry: str) -> tuple[str, ...]:
    found = {entry: None}
    for name in (queue := [entry]):
        new = [target for target in imports_of(name) if target not in found]
        found.update(dict.fromkeys(new))
        queue.extend(dict.fromkeys(new))
    return tuple(found)


_kept = lru_cache(_walk)
