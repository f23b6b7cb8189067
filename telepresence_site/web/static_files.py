"""Static files with their hash in the name, so that browsers can keep them for ever, and with
compressed copies.
"""

import posixpath
import re
from collections.abc import Iterator
from typing import Any

from django.core.files.base import ContentFile
from django.core.files.storage import Storage
from whitenoise.storage import CompressedManifestStaticFilesStorage

# A style sheet that lists others.
IMPORTED_SHEET = re.compile(r'(?m)^@import "([^"]+)";$')

# Strict patterns, because comments name modules too, in circles: `@param
# {import("./peer.js").Peer} peer`. A test checks that no import was missed.
IMPORTS = (
    (
        r"""(?m)^(?P<matched>(?P<names>(?:import|export)\b[^"';]*)"(?P<url>\.[^"]+)";)""",
        """%(names)s"%(url)s";""",
    ),
    (r"""(?P<matched>import\("(?P<url>\.[^"]+)"\)(?=\)))""", """import("%(url)s")"""),
)


class HashedModules(CompressedManifestStaticFilesStorage):
    """Also puts hashed names into the imports of JavaScript modules: otherwise a module would load
    twice, under both names. Nothing else in a script is changed (docs/explanation/decisions/).
    """

    # A module's hash depends on those of its imports: in the worst order, each pass completes one
    # module of the longest chain.
    max_post_process_passes = 50
    patterns = (*CompressedManifestStaticFilesStorage.patterns, ("*.js", IMPORTS))

    def post_process(
        self, paths: dict[str, tuple[Storage, str]], dry_run: bool = False, **options: Any
    ) -> Iterator[tuple[str, str | None, Any]]:
        """Replace each `@import` of a style sheet by the imported one, before names are hashed: a
        page that loads them one by one paints nothing until the last one has arrived.
        """
        for name in [] if dry_run else [name for name in paths if name.endswith(".css")]:
            text, folder = _text(*paths[name]), posixpath.dirname(name)

            def imported(found: re.Match[str], folder: str = folder) -> str:
                return _text(*paths[posixpath.join(folder, found[1])])

            whole = IMPORTED_SHEET.sub(imported, text)
            if whole != text:
                self.delete(name)
                paths[name] = (self, self.save(name, ContentFile(whole)))
        yield from super().post_process(paths, dry_run, **options)


def _text(storage: Storage, path: str) -> str:
    with storage.open(path) as file:
        return str(file.read(), "utf-8")
