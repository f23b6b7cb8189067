"""Zenodo (https://developers.zenodo.org/): depositions, and files in their buckets. Only the
request that publishes is left out.
"""

from collections.abc import Iterator, Mapping
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from experiments.deposit.repository import (
    DepositDraft,
    DepositError,
    Record,
    Repository,
    StoredFile,
    Tell,
)

OWN_DOI = "10.5281/"  # Zenodo's own, which it gives itself


class Zenodo(Repository):
    title = "Zenodo"
    home = "https://zenodo.org/api"
    sandbox = "https://sandbox.zenodo.org/api"
    token = "ZENODO_TOKEN"  # noqa: S105 -- its name
    scopes = "the scope deposit:write"

    def problems(self, record: Record) -> Iterator[str]:
        if not record.details.authors:
            yield "Zenodo needs at least one author."
        if not record.details.license:
            yield "Zenodo needs a licence for open data."

    def create(self, record: Record) -> DepositDraft:
        found = self.ask("POST", self._address(), {})
        draft = DepositDraft(str(found["id"]), found["links"]["html"])
        self.update(draft, record)
        return draft

    def update(self, draft: DepositDraft, record: Record) -> None:
        if self._found(draft).get("submitted"):
            raise DepositError(
                f"The dataset was published at {draft.url}. Use --new to begin another draft."
            )
        self.ask("PUT", self._address(draft), {"metadata": metadata(record)})

    def files(self, draft: DepositDraft) -> dict[str, StoredFile]:
        found = self._found(draft)
        return {
            one["filename"]: _stored(found, one["filename"], one["filesize"], one["checksum"])
            for one in found.get("files", ())
        }

    def upload(self, draft: DepositDraft, name: str, path: Path, tell: Tell) -> StoredFile:
        draft_now = self._found(draft)
        found = self.put(_address_of(draft_now, name), path, tell)
        return _stored(draft_now, found["key"], found["size"], found["checksum"])

    def _found(self, draft: DepositDraft) -> dict[str, Any]:
        found: dict[str, Any] = self.ask("GET", self._address(draft))
        return found

    def _address(self, draft: DepositDraft | None = None) -> str:
        base = f"{self.address}/deposit/depositions"
        return f"{base}/{quote(draft.id)}" if draft else base


def _address_of(draft: Mapping[str, Any], name: str) -> str:
    return f"{draft['links']['bucket']}/{quote(name)}"


def _stored(draft: Mapping[str, Any], name: str, size: Any, checksum: str) -> StoredFile:
    md5 = checksum.removeprefix("md5:")
    return StoredFile(name, int(size), md5, _address_of(draft, name))


def metadata(record: Record) -> dict[str, Any]:
    """Return the metadata of a deposition. Zenodo has numbers of its own for funders, so ours are
    part of the notes.
    """
    details = record.details
    labelled = {"Funder": details.funder, "Ethics approval": details.ethics}
    return _filled(
        title=record.title,
        upload_type="dataset",
        description=f"<p>{escape(record.description)}</p>",
        creators=[
            _filled(name=one.name, orcid=one.orcid, affiliation=one.affiliation)
            for one in details.authors
        ],
        access_right="open",
        license=details.license.lower(),
        keywords=list(details.keywords),
        notes="; ".join(f"{label}: {text}" for label, text in labelled.items() if text),
        related_identifiers=list(_related(record)),
    )


def _filled(**fields: Any) -> dict[str, Any]:
    return {name: value for name, value in fields.items() if value}


def _related(record: Record) -> Iterator[dict[str, str]]:
    details = record.details
    if details.preregistration:
        yield {"identifier": details.preregistration, "relation": "references"}
    if details.doi and not details.doi.startswith(OWN_DOI):
        yield {"identifier": details.doi, "relation": "isIdenticalTo"}
