"""Metadata of a dataset in a repository: authors, licence, funder, preregistration, DOI, keywords
and ethics approval. They are not part of the frozen definition, because a DOI and often the licence
follow after the data. The JSON-LD has terms of schema.org only.
"""

import re
from collections.abc import Mapping
from typing import Any

import msgspec

# SPDX identifiers (https://spdx.org/licenses/) of common licences for data.
LICENCES = (
    *("CC0-1.0", "CC-BY-4.0", "CC-BY-SA-4.0", "CC-BY-NC-4.0", "CC-BY-ND-4.0"),
    *("CC-BY-NC-SA-4.0", "CC-BY-NC-ND-4.0", "ODC-By-1.0", "ODbL-1.0", "PDDL-1.0"),
)
SPDX, ORCID, DOI = "https://spdx.org/licenses/", "https://orcid.org/", "https://doi.org/"
PREREGISTRATION, ETHICS = "Preregistration", "Ethics approval"
_ORCID = re.compile(r"\d{4}-\d{4}-\d{4}-\d{3}[\dX]", re.ASCII)
# A DOI is "10.", a registrant, "/" and a suffix without white space (ISO 26324).
_DOI = re.compile(r"10\.\d{4,9}(\.\d+)*/\S+", re.ASCII)
_URL = re.compile(r"https?://[^\s/]+\S*")


class Author(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`name` is "Family name, Given names"."""

    name: str
    orcid: str = ""
    affiliation: str = ""


class PublicationDetails(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Empty: not known yet. `license` is an SPDX identifier, `preregistration` an address, `doi` a
    DOI without an address before it, `ethics` the approving body with its reference.
    """

    authors: tuple[Author, ...] = ()
    license: str = ""
    funder: str = ""
    preregistration: str = ""
    doi: str = ""
    keywords: tuple[str, ...] = ()
    ethics: str = ""

    @property
    def missing(self) -> tuple[str, ...]:
        return tuple(name for name in self.__struct_fields__ if not getattr(self, name))


def plain_orcid(text: str) -> str:
    return text.strip().removeprefix("http://").removeprefix("https://").removeprefix("orcid.org/")


def plain_doi(text: str) -> str:
    return re.sub(r"^(https?://(dx\.)?doi\.org/|doi:\s*)", "", text.strip(), flags=re.IGNORECASE)


def is_orcid(text: str) -> bool:
    """Tell whether the check character is right (ISO 7064, MOD 11-2)."""
    if not _ORCID.fullmatch(text):
        return False
    characters = text.replace("-", "")
    total = 0
    for digit in characters[:-1]:
        total = (total + int(digit)) * 2
    return "0123456789X"[(12 - total % 11) % 11] == characters[-1]


def is_doi(text: str) -> bool:
    return _DOI.fullmatch(text) is not None


def is_address(text: str) -> bool:
    return _URL.fullmatch(text) is not None


def from_stored(stored: Any) -> PublicationDetails:
    return msgspec.convert(stored, PublicationDetails)


def json_ld(details: PublicationDetails) -> dict[str, Any]:
    """Return the details as members of a schema.org Dataset, without empty ones."""
    texts = ((PREREGISTRATION, "url", details.preregistration), (ETHICS, "text", details.ethics))
    works = [_named("CreativeWork", name) | {key: text} for name, key, text in texts if text]
    found = {
        "author": [_person(one) for one in details.authors],
        "license": f"{SPDX}{details.license}" if details.license else "",
        "funder": _named("Organization", details.funder) if details.funder else "",
        "identifier": f"{DOI}{details.doi}" if details.doi else "",
        "keywords": list(details.keywords),
        "subjectOf": works,
    }
    return {name: value for name, value in found.items() if value}


def _person(author: Author) -> dict[str, Any]:
    found: dict[str, Any] = _named("Person", author.name)
    if author.orcid:
        found["identifier"] = f"{ORCID}{author.orcid}"
    if author.affiliation:
        found["affiliation"] = _named("Organization", author.affiliation)
    return found


def _named(kind: str, name: str) -> dict[str, Any]:
    return {"@type": kind, "name": name}


def from_json_ld(found: Mapping[str, Any]) -> PublicationDetails:
    """Return the details that `json_ld` wrote; empty ones for a description without any."""
    works = {one.get("name"): one for one in found.get("subjectOf", ())}
    authors = tuple(
        Author(
            name=one["name"],
            orcid=one.get("identifier", "").removeprefix(ORCID),
            affiliation=one.get("affiliation", {}).get("name", ""),
        )
        for one in found.get("author", ())
    )
    return PublicationDetails(
        authors=authors,
        license=found.get("license", "").removeprefix(SPDX),
        funder=found.get("funder", {}).get("name", ""),
        preregistration=works.get(PREREGISTRATION, {}).get("url", ""),
        doi=found.get("identifier", "").removeprefix(DOI),
        keywords=tuple(found.get("keywords", ())),
        ethics=works.get(ETHICS, {}).get("text", ""),
    )
