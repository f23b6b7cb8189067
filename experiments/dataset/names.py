"""Where the files of a dataset stand, named as Psych-DS asks for: pairs of a keyword of lower-case
letters and a value of letters and digits, then `_data.csv`.

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
    """A folder that holds no dataset, or a broken one; says which file, and what is wrong with
    it.
    """


def table_path(name: str) -> str:
    """Return where a table stands."""
    return f"data/description-{name}_data.csv"


def numbers_path(name: str, session: str) -> str:
    """Return where the states or network samples of a session stand.

    Raises:
        DatasetError: a code that cannot be the name of a file.
    """
    return f"data/{name}/session-{_named(session, _CODE).replace('-', '')}_data.csv"


def plan_path(name: str) -> str:
    """Return where a floor plan stands.

    Raises:
        DatasetError: a name that cannot be the name of a file.
    """
    return f"plans/{_named(name, _PLAN)}.json"


def _named(name: str, pattern: re.Pattern[str]) -> str:
    if not pattern.match(name):
        raise DatasetError(f"{name!r} cannot be used as a file name")
    return name


def questionnaire_paths(slugs: Iterable[str]) -> dict[str, str]:
    """Return where each questionnaire's answers stand, a line a response, by its name in order."""
    return {
        slug: f"data/questionnaire-{value}_data.csv"
        for slug, value in keyword_values(slugs).items()
    }


def keyword_values(slugs: Iterable[str]) -> dict[str, str]:
    """Return names as values of letters and digits alone, in their order: `nasa-tlx` is `nasaTlx`.

    Those that would be the same, also where a file system does not tell capitals, have a part of
    their SHA-256 at the end; so has one without any letter or digit.
    """
    ordered = sorted(set(slugs))
    plain = {slug: _camel(slug) for slug in ordered}
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
