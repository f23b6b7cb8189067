"""Zenodo and the OSF on a loopback port, as far as a deposit needs them, with their refusals.

Read from zenodo/developers.zenodo.org (overview/_api-basics.md: status codes, scopes, errors;
resources/deposit/_representation.md: required metadata and their vocabularies; files and buckets),
and from CenterForOpenScience/waterbutler (docs/api.rst: actions and 409;
providers/osfstorage/metadata.py: hashes) with the JSON API of https://developer.osf.io/.
"""

import json
import re
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import md5, sha256
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from urllib.parse import parse_qs, unquote, urlsplit

GOOD, READ_ONLY = "good-token", "read-only-token"
MOST_NAME = 255
UPLOAD_TYPES = {"publication", "poster", "presentation", "dataset", "image", "video", "software"}
LICENCES = {"cc0-1.0", "cc-by-4.0", "cc-by-sa-4.0", "odbl-1.0"}


@dataclass
class Shelf:
    """The content of a double, and the mistakes that it is to make."""

    drafts: dict[str, dict] = field(default_factory=dict)
    files: dict[str, dict[str, bytes]] = field(default_factory=dict)
    requests: list[tuple[str, str]] = field(default_factory=list)
    quota: int = 10**9
    hangs_up_at: str = ""  # the name of a file during which the connection breaks
    garbles: str = ""  # the name of a file whose last byte is changed
    redirects: bool = False

    @property
    def uploads(self) -> list[str]:
        """The names of the files that were sent, in order."""
        paths = [unquote(path) for method, path in self.requests if method == "PUT"]
        return [path for path in paths if "/files/" in path or "kind=file" in path]


class Refused(Exception):
    def __init__(self, status: int, message: str, *errors: dict) -> None:
        super().__init__(message)
        self.status, self.message, self.errors = status, message, errors


class Double(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    shelf: Shelf

    def log_message(self, *_args) -> None:
        pass

    @property
    def base(self) -> str:
        return f"http://127.0.0.1:{self.server.server_address[1]}"

    def handle_any(self) -> None:
        self.shelf.requests.append((self.command, self.path))
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        try:
            if self.shelf.redirects:
                self.send_response(302)
                self.send_header("Location", f"http://localhost:{self.server.server_address[1]}/")
                self.send_header("Content-Length", "0")
                self.end_headers()
                return
            self.admit()
            status, found = self.answer(body)
        except Refused as refused:
            status = refused.status
            found = self.error(refused)
        except ConnectionAbortedError:
            self.close_connection = True
            return
        text = b"" if found is None else json.dumps(found).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(text)))
        self.end_headers()
        self.wfile.write(text)

    do_GET = do_POST = do_PUT = do_PATCH = do_DELETE = handle_any  # noqa: N815

    def admit(self) -> None:
        token = self.headers.get("Authorization", "").removeprefix("Bearer ")
        if token not in {GOOD, READ_ONLY}:
            raise Refused(401, "The server could not verify that you are authorized.")
        if token == READ_ONLY and self.command != "GET":
            raise Refused(403, "You do not have the permission: the token lacks a scope.")

    def stored(self, draft: str, name: str, content: bytes) -> bytes:
        if len(name) > MOST_NAME:
            raise Refused(400, "The name of the file is too long.")
        if name == self.shelf.hangs_up_at:
            raise ConnectionAbortedError
        taken = sum(len(one) for one in self.shelf.files[draft].values())
        if taken + len(content) > self.shelf.quota:
            raise self.full()
        if name == self.shelf.garbles:
            content = content[:-1] + b"?"
        self.shelf.files[draft][name] = content
        return content

    def full(self) -> Refused:
        return Refused(413, "The storage is full.")

    def error(self, refused: Refused) -> dict:
        raise NotImplementedError

    def answer(self, body: bytes) -> tuple[int, object]:
        raise NotImplementedError


class ZenodoDouble(Double):
    """POST /api/deposit/depositions, PUT metadata, PUT into the bucket."""

    def error(self, refused: Refused) -> dict:
        return {"message": refused.message, "status": refused.status, "errors": refused.errors}

    def full(self) -> Refused:
        return Refused(400, "Bucket quota exceeded.")

    def answer(self, body: bytes) -> tuple[int, object]:
        path = unquote(urlsplit(self.path).path)
        if found := re.fullmatch(r"/api/files/bucket-(\d+)/(.+)", path):
            return self._put(*found.groups(), body)
        found = re.fullmatch(r"/api/deposit/depositions(?:/(\d+))?", path)
        if found is None:
            raise Refused(404, "Not found")
        if self.command != "GET" and self.headers.get("Content-Type") != "application/json":
            raise Refused(415, "Unsupported media type")
        if found[1] is None and self.command == "POST":
            key = str(len(self.shelf.drafts) + 1)
            self.shelf.drafts[key] = {"metadata": {}, "submitted": False}
            self.shelf.files[key] = {}
            return 201, self._about(key)
        if found[1] not in self.shelf.drafts:
            raise Refused(404, "Deposition not found")
        if self.command == "PUT":
            self.shelf.drafts[found[1]]["metadata"] = self._checked(json.loads(body)["metadata"])
        return 200, self._about(found[1])

    def _put(self, key: str, name: str, body: bytes) -> tuple[int, object]:
        if key not in self.shelf.drafts:
            raise Refused(404, "Bucket does not exist.")
        if self.shelf.drafts[key]["submitted"]:
            raise Refused(403, "The bucket is locked.")
        content = self.stored(key, name, body)
        about = {"key": name, "size": len(content), "checksum": f"md5:{_md5(content)}"}
        return 201, about

    def _about(self, key: str) -> dict:
        files = [
            {"id": name, "filename": name, "filesize": len(content), "checksum": _md5(content)}
            for name, content in self.shelf.files[key].items()
        ]
        links = {
            "bucket": f"{self.base}/api/files/bucket-{key}",
            "html": f"{self.base}/deposit/{key}",
            "publish": f"{self.base}/api/deposit/depositions/{key}/actions/publish",
        }
        return {"id": int(key), "links": links, "files": files, **self.shelf.drafts[key]}

    @staticmethod
    def _checked(metadata: dict) -> dict:
        errors = [
            {"field": f"metadata.{name}", "message": "Missing data for required field."}
            for name in ("title", "upload_type", "description", "creators", "access_right")
            if not metadata.get(name)
        ]
        if metadata.get("upload_type") not in UPLOAD_TYPES:
            errors.append({"field": "metadata.upload_type", "message": "Not a valid choice"})
        if metadata.get("license") not in LICENCES:
            errors.append({"field": "metadata.license", "message": "Invalid license provided"})
        if not all(creator.get("name") for creator in metadata.get("creators", ())):
            errors.append({"field": "metadata.creators", "message": "Needs a name"})
        if errors:
            raise Refused(400, "Validation error.", *errors)
        return metadata


class OsfDouble(Double):
    """Nodes of the API v2, and files of WaterButler at the same port."""

    def error(self, refused: Refused) -> dict:
        if "/v1/" in self.path:
            return {"code": refused.status, "message": refused.message}
        return {"errors": [*refused.errors, {"detail": refused.message}]}

    def full(self) -> Refused:
        return Refused(507, "The project is over its storage limit.")

    def answer(self, body: bytes) -> tuple[int, object]:
        parts = urlsplit(self.path)
        path, query = unquote(parts.path), {k: v[0] for k, v in parse_qs(parts.query).items()}
        if found := re.fullmatch(r"/v1/resources/(\w+)/providers/osfstorage/(.*)", path):
            return self._file(found[1], found[2], query, body)
        if path == "/v2/nodes/" and self.command == "POST":
            return self._create(json.loads(body)["data"])
        found = re.fullmatch(r"/v2/nodes/(\w+)/(files/)?", path)
        if found is None or found[1] not in self.shelf.drafts:
            raise Refused(404, "Not found.")
        if found[2]:
            links = {"upload": f"{self.base}/v1/resources/{found[1]}/providers/osfstorage/"}
            return 200, {"data": [{"attributes": {"provider": "osfstorage"}, "links": links}]}
        if self.command == "PATCH":
            self.shelf.drafts[found[1]] |= json.loads(body)["data"]["attributes"]
        return 200, {"data": self._about(found[1])}

    def _create(self, data: dict) -> tuple[int, object]:
        if self.headers.get("Content-Type") != "application/vnd.api+json":
            raise Refused(415, "Unsupported media type")
        attributes = data["attributes"]
        for name in ("title", "category"):
            if not attributes.get(name):
                pointer = {"pointer": f"/data/attributes/{name}"}
                raise Refused(400, "Invalid.", {"source": pointer, "detail": "Required."})
        key = f"node{len(self.shelf.drafts) + 1}"
        self.shelf.drafts[key] = attributes
        self.shelf.files[key] = {}
        return 201, {"data": self._about(key)}

    def _about(self, key: str) -> dict:
        links = {"html": f"{self.base}/{key}/"}
        return {"id": key, "type": "nodes", "attributes": self.shelf.drafts[key], "links": links}

    def _file(self, node: str, item: str, query: dict, body: bytes) -> tuple[int, object]:
        if node not in self.shelf.drafts:
            raise Refused(404, "Could not retrieve the project.")
        files = self.shelf.files[node]
        if self.command == "GET":
            return 200, {"data": [self._entity(node, name) for name in files]}
        if item:
            name = next((one for one in files if _key(one) == item), None)
            if name is None:
                raise Refused(404, "Could not retrieve file or directory.")
            self.stored(node, name, body)
            return 200, {"data": self._entity(node, name)}
        name = query["name"]
        if name in files:
            raise Refused(409, f'Cannot complete action: file or folder "{name}" already exists')
        self.stored(node, name, body)
        return 201, {"data": self._entity(node, name)}

    def _entity(self, node: str, name: str) -> dict:
        content = self.shelf.files[node][name]
        hashes = {"md5": _md5(content), "sha256": sha256(content).hexdigest()}
        upload = f"{self.base}/v1/resources/{node}/providers/osfstorage/{_key(name)}?kind=file"
        about = {"name": name, "kind": "file", "size": len(content), "extra": {"hashes": hashes}}
        return {"id": f"osfstorage/{_key(name)}", "attributes": about, "links": {"upload": upload}}


def _md5(content: bytes) -> str:
    return md5(content, usedforsecurity=False).hexdigest()


def _key(name: str) -> str:
    return _md5(name.encode())[:24]


@contextmanager
def running(kind: type[Double]):
    """Yield the shelf of a double, and the address of its API."""
    shelf = Shelf()
    handler = type("Running", (kind,), {"shelf": shelf})
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
        thread.start()
        port = server.server_address[1]
        yield shelf, f"http://127.0.0.1:{port}/{'api' if kind is ZenodoDouble else 'v2'}"
        server.shutdown()
        thread.join()
