"""Zenodo (https://developers.zenodo.org/): depositions and their files. It publishes nothing."""

from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from msgspec.structs import asdict

from experiments.deposit import repository as base
from experiments.deposit.repository import DepositDraft, DepositError, Record, StoredFile, Tell

OWN_DOI = "10.5281/"  # of the DOIs that Zenodo assigns


class Zenodo(base.Repository):
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
            text = f"The dataset was published at {draft.url}. Use --new to begin another draft."
            raise DepositError(text)
        self.ask("PUT", self._address(draft), {"metadata": metadata(record)})

    def files(self, draft: DepositDraft) -> dict[str, StoredFile]:
        return {
            one["filename"]: _stored(one["filename"], one["filesize"], one["checksum"])
            for one in self._found(draft).get("files", ())
        }

    def upload(self, draft: DepositDraft, name: str, path: Path, tell: Tell) -> StoredFile:
        bucket = self._found(draft)["links"]["bucket"]
        found = self.put(f"{bucket}/{quote(name)}", path, tell)
        return _stored(found["key"], found["size"], found["checksum"])

    def _found(self, draft: DepositDraft) -> dict[str, Any]:
        found: dict[str, Any] = self.ask("GET", self._address(draft))
        return found

    def _address(self, draft: DepositDraft | None = None) -> str:
        every = f"{self.address}/deposit/depositions"
        return f"{every}/{quote(draft.id)}" if draft else every


def _stored(name: str, size: Any, checksum: str) -> StoredFile:
    return StoredFile(name, int(size), checksum.removeprefix("md5:"))


def metadata(record: Record) -> dict[str, Any]:
    """Return the metadata of a deposition. Zenodo refers to funders by its own ids, so these are
    part of the notes.
    """
    details = record.details
    labelled = {"Funder": details.funder, "Ethics approval": details.ethics}
    fields = {
        "title": record.title,
        "upload_type": "dataset",
        "description": f"<p>{escape(record.description)}</p>",
        "creators": [_filled(asdict(one)) for one in details.authors],
        "access_right": "open",
        "license": details.license.lower(),
        "keywords": list(details.keywords),
        "notes": "; ".join(f"{label}: {text}" for label, text in labelled.items() if text),
        "related_identifiers": list(_related(record)),
    }
    return _filled(fields)


def _filled(fields: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in fields.items() if value}


def _related(record: Record) -> Iterator[dict[str, str]]:
    details = record.details
    if details.preregistration:
        yield {"identifier": details.preregistration, "relation": "references"}
    if details.doi and not details.doi.startswith(OWN_DOI):
        yield {"identifier": details.doi, "relation": "isIdenticalTo"}
