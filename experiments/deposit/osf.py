"""The Open Science Framework: projects by its API (https://developer.osf.io/), files by WaterButler
(https://waterbutler.readthedocs.io/). A project stays private until its owner makes it public.
"""

from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode

from experiments.deposit import repository as base
from experiments.deposit.repository import DepositDraft, DepositError, Record, StoredFile, Tell

JSON_API = "application/vnd.api+json"
STORAGE = "osfstorage"


class Osf(base.Repository):
    title = "OSF"
    home = "https://api.osf.io/v2"
    sandbox = "https://api.test.osf.io/v2"
    token = "OSF_TOKEN"  # noqa: S105 -- its name
    scopes = "the scope osf.full_write"
    domain = "osf.io"

    def create(self, record: Record) -> DepositDraft:
        attributes = _attributes(record) | {"category": "project", "public": False}
        body = {"data": {"type": "nodes", "attributes": attributes}}
        found = self.ask("POST", f"{self.address}/nodes/", body, JSON_API)["data"]
        return DepositDraft(found["id"], found["links"]["html"])

    def update(self, draft: DepositDraft, record: Record) -> None:
        address = f"{self.address}/nodes/{quote(draft.id)}/"
        if self.ask("GET", address)["data"]["attributes"]["public"]:
            text = f"The project {draft.url} is public. Use --new to begin another one."
            raise DepositError(text)
        data = {"type": "nodes", "id": draft.id, "attributes": _attributes(record)}
        self.ask("PATCH", address, {"data": data}, JSON_API)

    def files(self, draft: DepositDraft) -> dict[str, StoredFile]:
        found = self.ask("GET", f"{self._storage(draft)}?meta=")["data"]
        stored = [_stored(one) for one in found if one["attributes"]["kind"] == "file"]
        return {one.name: one for one in stored}

    def upload(self, draft: DepositDraft, name: str, path: Path, tell: Tell) -> StoredFile:
        known = self.files(draft).get(name)
        query = urlencode({"kind": "file"} if known else {"kind": "file", "name": name})
        address = known.address if known else self._storage(draft)
        return _stored(self.put(f"{address}?{query}", path, tell)["data"])

    def _storage(self, draft: DepositDraft) -> str:
        address = f"{self.address}/nodes/{quote(draft.id)}/files/"
        for one in self.ask("GET", address)["data"]:
            if one["attributes"]["provider"] == STORAGE:
                return str(one["links"]["upload"]).partition("?")[0]
        raise DepositError(f"The project {draft.url} has no OSF storage.")


def _stored(found: dict[str, Any]) -> StoredFile:
    about = found["attributes"]
    address = str(found["links"]["upload"]).partition("?")[0]
    return StoredFile(about["name"], int(about["size"]), about["extra"]["hashes"]["md5"], address)


def _attributes(record: Record) -> dict[str, Any]:
    """Return the attributes of a project. The OSF refers to authors and licences by its own ids, so
    these are part of the description.
    """
    details = record.details
    labelled = {"Licence": details.license, "Funder": details.funder}
    labelled |= {"Preregistration": details.preregistration, "DOI": details.doi}
    labelled["Ethics approval"] = details.ethics
    lines = [record.description, "; ".join(one.name for one in details.authors)]
    lines += [f"{label}: {text}" for label, text in labelled.items() if text]
    description = "\n".join(filter(None, lines))
    return {"title": record.title, "description": description, "tags": list(details.keywords)}
