"""The names of a dataset's files as Psych-DS requires them: pairs of a keyword (lower-case letters)
and a value (letters and digits), then `_data.csv`.

    data/description-<table>_data.csv
    data/questionnaire-<name>_data.csv
    data/states/session-<code>_data.csv, data/network/ likewise
"""

import re
import unicodedata
from collections.abc import Iterable
from hashlib import sha256

DIGEST = 8  # characters of the sum that tells apart names that would be the same
_CODE = re.compile(r"^[A-Za-z0-9-]{1,64}$")
_PLAN = re.compile(r"^[a-z0-9][a-z0-9_-]{0,63}$")
_PARTS = re.compile(r"[^A-Za-z0-9]+")


class DatasetError(ValueError):
    """A folder without a dataset, or with a broken one; names the file and what is wrong."""


def table_path(name: str) -> str:
    return f"data/description-{name}_data.csv"


def numbers_path(name: str, session: str) -> str:
    """Return the path of the states or network samples of a session.

    Raises:
        DatasetError: a code that cannot be the name of a file.
    """
    return f"data/{name}/session-{_named(session, _CODE).replace('-', '')}_data.csv"


def plan_path(name: str) -> str:
    """Return the path of a floor plan.

    Raises:
        DatasetError: a name that cannot be the name of a file.
    """
    return f"plans/{_named(name, _PLAN)}.json"


def _named(name: str, pattern: re.Pattern[str]) -> str:
    if not pattern.match(name):
        raise DatasetError(f"{name!r} cannot be used as a file name")
    return name


def questionnaire_paths(slugs: Iterable[str]) -> dict[str, str]:
    """Return the path of each questionnaire's answers, a line a response, by its name in order."""
    values = keyword_values(slugs)
    return {slug: f"data/questionnaire-{value}_data.csv" for slug, value in values.items()}


def keyword_values(slugs: Iterable[str]) -> dict[str, str]:
    """Return names as values of letters and digits alone, in their order: `nasa-tlx` is `nasaTlx`.

    Values that would be the same, also on a file system that ignores case, end with a part of the
    name's SHA-256; so does the value of a name without any letter or digit.
    """
    plain = {slug: _camel(slug) for slug in sorted(set(slugs))}
    shared = [value.casefold() for value in plain.values()]
    return {
        slug: value
        if value and shared.count(value.casefold()) == 1
        else f"{value}{sha256(slug.encode()).hexdigest()[:DIGEST]}"
        for slug, value in plain.items()
    }


def _camel(slug: str) -> str:
    letters = unicodedata.normalize("NFKD", slug).encode("ascii", "ignore").decode()
    first, *rest = [part for part in _PARTS.split(letters) if part] or [""]
    return first + "".join(part[0].upper() + part[1:] for part in rest)
