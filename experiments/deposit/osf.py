"""The Open Science Framework: projects by its API (https://developer.osf.io/), files by WaterButler
(https://waterbutler.readthedocs.io/). A project stays private until its owner makes it public.
"""

from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode

from experiments.deposit.client import DepositError, Progress
from experiments.deposit.repository import DepositDraft, Record, Repository, StoredFile

JSON_API = "application/vnd.api+json"
STORAGE = "osfstorage"


class Osf(Repository):
    """Projects, and files in their storage."""

    title = "OSF"
    home = "https://api.osf.io/v2"
    sandbox = "https://api.test.osf.io/v2"
    token = "OSF_TOKEN"  # noqa: S105 -- its name
    scopes = "the scope osf.full_write"
    domain = "osf.io"

    def create(self, record: Record) -> DepositDraft:
        """Make a private project."""
        attributes = _attributes(record) | {"category": "project", "public": False}
        body = {"data": {"type": "nodes", "attributes": attributes}}
        found = self.client.ask("POST", f"{self.client.address}/nodes/", body, JSON_API)["data"]
        return DepositDraft(found["id"], found["links"]["html"])

    def update(self, draft: DepositDraft, record: Record) -> None:
        """Describe a project that is private."""
        address = f"{self.client.address}/nodes/{quote(draft.id)}/"
        if self.client.ask("GET", address)["data"]["attributes"]["public"]:
            raise DepositError(
                f"The project {draft.url} is public. Use --new to begin another one."
            )
        data = {"type": "nodes", "id": draft.id, "attributes": _attributes(record)}
        self.client.ask("PATCH", address, {"data": data}, JSON_API)

    def files(self, draft: DepositDraft) -> dict[str, StoredFile]:
        """Return the files at the top of its storage."""
        found = self.client.ask("GET", f"{self._storage(draft)}?meta=")
        return {
            stored.name: stored
            for one in found["data"]
            if one["attributes"]["kind"] == "file"
            for stored in (_stored(one),)
        }

    def upload(self, draft: DepositDraft, name: str, path: Path, progress: Progress) -> StoredFile:
        """Add a file, or a version of the one that has this name."""
        known = self.files(draft).get(name)
        address = (
            f"{known.address}?kind=file"
            if known
            else f"{self._storage(draft)}?{urlencode({'kind': 'file', 'name': name})}"
        )
        return _stored(self.client.upload(address, path, progress)["data"])

    def _storage(self, draft: DepositDraft) -> str:
        """Return where files go: which server that is, the project says."""
        address = f"{self.client.address}/nodes/{quote(draft.id)}/files/"
        for one in self.client.ask("GET", address)["data"]:
            if one["attributes"]["provider"] == STORAGE:
                return str(one["links"]["upload"]).partition("?")[0]
        raise DepositError(f"The project {draft.url} has no OSF storage.")


def _stored(found: dict[str, Any]) -> StoredFile:
    about = found["attributes"]
    address = str(found["links"]["upload"]).partition("?")[0]
    return StoredFile(about["name"], int(about["size"]), about["extra"]["hashes"]["md5"], address)


def _attributes(record: Record) -> dict[str, Any]:
    """Return what a project says. The OSF knows authors and licences by numbers of its own, so that
    ours stand in the description.
    """
    details = record.details
    lines = [
        record.description,
        "; ".join(one.name for one in details.authors),
        *(
            f"{label}: {text}"
            for label, text in (
                ("Licence", details.license),
                ("Funder", details.funder),
                ("Preregistration", details.preregistration),
                ("DOI", details.doi),
                ("Ethics approval", details.ethics),
            )
            if text
        ),
    ]
    description = "\n".join(filter(None, lines))
    return {"title": record.title, "description": description, "tags": list(details.keywords)}
