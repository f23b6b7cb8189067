"""The formats of an export, by name: each module of this package is one (CONTRIBUTING.md: how to
add one). An export has its files in the order of these names.
"""

from experiments.export.format import ExportFormat
from experiments.extraction.selection import Selection
from surveys.registry import family


class UnknownFormatError(LookupError):
    """There is no export format of that name."""


FORMATS = family(__name__, __path__, ExportFormat)
# Those that a user may request.
ON_REQUEST = {name: one for name, one in FORMATS.items() if one.label}


def chosen(choice: Selection) -> list[type[ExportFormat]]:
    """Return the formats of an export, in the order of their files."""
    unknown = sorted(set(choice.formats) - set(ON_REQUEST))
    if unknown:
        raise UnknownFormatError(f"there is no export format {', '.join(unknown)}")
    return [one for name, one in FORMATS.items() if one.is_in(name, choice)]
