"""Static files under names that hold their hash, so that browsers may keep them for ever, and scripts without comments and with short names."""

from collections.abc import Iterator
from typing import Any

import minify
from django.core.files.base import ContentFile
from whitenoise.storage import CompressedManifestStaticFilesStorage


class HashedModules(CompressedManifestStaticFilesStorage):
    """Hashed names inside JavaScript modules' imports too; without that a module would load twice, under both names.

    Django rewrites only `import` lines that end in a semicolon; a test reads the collected files to see that none was missed.
    """

    support_js_module_import_aggregation = True

    def post_process(self, paths: dict[str, Any], dry_run: bool = False, **options: Any) -> Iterator[Any]:  # noqa: FBT001, FBT002 -- Django's signature
        """Take comments and blanks out of our scripts and shorten their names, then hash everything."""
        if not dry_run:
            paths = {name: self._shortened(name) or found for name, found in paths.items()}
        yield from super().post_process(paths, dry_run, **options)

    def _shortened(self, name: str) -> tuple["HashedModules", str] | None:
        """Rewrite a collected script, and return where it is found now; what others wrote (admin's) stays as it is."""
        if not (name.startswith("js/") and name.endswith(".js")):
            return None
        with self.open(name) as file:
            source = file.read().decode()
        self.delete(name)
        self.save(name, ContentFile(minify.string("text/javascript", source)))
        return self, name
