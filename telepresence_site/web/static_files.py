"""Static files under names that hold their hash, so that browsers may keep them for ever, each with
its compressed copy beside it.
"""

import posixpath
import re
from collections.abc import Callable, Iterator
from typing import Any

from django.core.files.base import ContentFile
from django.core.files.storage import Storage
from whitenoise.storage import CompressedManifestStaticFilesStorage

# A style sheet that lists others.
IMPORTED_SHEET = re.compile(r'(?m)^@import "([^"]+)";$')

# Anchored to what our modules write, because their comments name modules too, in circles: `@param
# {import("./peer.js").Peer} peer`. A test reads the collected files to see that none was missed.
IMPORTS = (
    (
        r"""(?m)^(?P<matched>(?P<names>(?:import|export)\b[^"';]*)"(?P<url>\.[^"]+)";)""",
        """%(names)s"%(url)s";""",
    ),
    (r"""(?P<matched>import\("(?P<url>\.[^"]+)"\)(?=\)))""", """import("%(url)s")"""),
)


class HashedModules(CompressedManifestStaticFilesStorage):
    """Hashed names inside JavaScript modules' imports too; without that a module would load twice,
    under both names.

    Nothing else in a script is changed: what a visitor's browser runs is what was written and
    tested (docs/explanation/decisions/).
    """

    # A name is known once the names of all that the module imports are: a pass for each module of
    # the longest chain, if they come in the worst order.
    max_post_process_passes = 50
    patterns = (*CompressedManifestStaticFilesStorage.patterns, ("*.js", IMPORTS))

    def post_process(
        self, paths: dict[str, tuple[Storage, str]], dry_run: bool = False, **options: Any
    ) -> Iterator[tuple[str, str | None, Any]]:
        """Put the style sheets that another one lists in the places of their names, before names
        are hashed: a page that links them one by one paints nothing until the last one is there.
        """
        for name in [] if dry_run else [name for name in paths if name.endswith(".css")]:
            text = _text(*paths[name])
            whole = IMPORTED_SHEET.sub(_sheet_beside(name, paths), text)
            if whole != text:
                self.delete(name)
                paths[name] = (self, self.save(name, ContentFile(whole)))
        yield from super().post_process(paths, dry_run, **options)


def _sheet_beside(
    name: str, paths: dict[str, tuple[Storage, str]]
) -> Callable[[re.Match[str]], str]:
    return lambda listed: _text(*paths[posixpath.join(posixpath.dirname(name), listed[1])])


def _text(storage: Storage, path: str) -> str:
    with storage.open(path) as file:
        return str(file.read(), "utf-8")
