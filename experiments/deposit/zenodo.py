"""Zenodo (https://developers.zenodo.org/): depositions, and files in their buckets. Only the
request that publishes is left out.
"""

from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from experiments.definition.publication import Author
from experiments.deposit.client import DepositError, Progress
from experiments.deposit.repository import DepositDraft, Record, Repository, StoredFile

OWN_DOI = "10.5281/"  # Zenodo's own, which it gives itself


class Zenodo(Repository):
    """Depositions."""

    title = "Zenodo"
    home = "https://zenodo.org/api"
    sandbox = "https://sandbox.zenodo.org/api"
    token = "ZENODO_TOKEN"  # noqa: S105 -- its name
    scopes = "the scope deposit:write"

    def problems(self, record: Record) -> Iterator[str]:
        """Yield what is missing that Zenodo requires."""
        if not record.details.authors:
            yield "Zenodo needs at least one author."
        if not record.details.license:
            yield "Zenodo needs a licence for open data."

    def create(self, record: Record) -> DepositDraft:
        """Make an empty deposition, and describe it."""
        found = self.client.ask("POST", self._address(), {})
        draft = DepositDraft(str(found["id"]), found["links"]["html"])
        self.update(draft, record)
        return draft

    def update(self, draft: DepositDraft, record: Record) -> None:
        """Describe a deposition that was not published."""
        if self._found(draft).get("submitted"):
            raise DepositError(
                f"The dataset was published at {draft.url}. Use --new to begin another draft."
            )
        self.client.ask("PUT", self._address(draft), {"metadata": metadata(record)})

    def files(self, draft: DepositDraft) -> dict[str, StoredFile]:
        """Return its files."""
        found = self._found(draft)
        bucket = found["links"]["bucket"]
        return {
            one["filename"]: StoredFile(
                one["filename"],
                int(one["filesize"]),
                one["checksum"].removeprefix("md5:"),
                f"{bucket}/{quote(one['filename'])}",
            )
            for one in found.get("files", ())
        }

    def upload(self, draft: DepositDraft, name: str, path: Path, progress: Progress) -> StoredFile:
        """Put a file into the bucket; one of the same name is replaced."""
        address = f"{self._found(draft)['links']['bucket']}/{quote(name)}"
        found = self.client.upload(address, path, progress)
        md5 = found["checksum"].removeprefix("md5:")
        return StoredFile(found["key"], int(found["size"]), md5, address)

    def _found(self, draft: DepositDraft) -> dict[str, Any]:
        found: dict[str, Any] = self.client.ask("GET", self._address(draft))
        return found

    def _address(self, draft: DepositDraft | None = None) -> str:
        base = f"{self.client.address}/deposit/depositions"
        return f"{base}/{quote(draft.id)}" if draft else base


def metadata(record: Record) -> dict[str, Any]:
    """Return the metadata of a deposition; Zenodo knows funders by numbers of its own, so that ours
    stand in the notes.
    """
    details = record.details
    notes = [
        f"{label}: {text}"
        for label, text in (("Funder", details.funder), ("Ethics approval", details.ethics))
        if text
    ]
    found = {
        "title": record.title,
        "upload_type": "dataset",
        "description": f"<p>{escape(record.description)}</p>",
        "creators": [_creator(one) for one in details.authors],
        "access_right": "open",
        "license": details.license.lower(),
        "keywords": list(details.keywords),
        "notes": "; ".join(notes),
        "related_identifiers": list(_related(record)),
    }
    return {name: value for name, value in found.items() if value}


def _creator(author: Author) -> dict[str, str]:
    found = {"name": author.name, "orcid": author.orcid, "affiliation": author.affiliation}
    return {name: value for name, value in found.items() if value}


def _related(record: Record) -> Iterator[dict[str, str]]:
    details = record.details
    if details.preregistration:
        yield {"identifier": details.preregistration, "relation": "references"}
    if details.doi and not details.doi.startswith(OWN_DOI):
        yield {"identifier": details.doi, "relation": "isIdenticalTo"}
