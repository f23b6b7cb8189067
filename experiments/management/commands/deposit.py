"""`manage.py deposit`: uploads a dataset as a draft, which its owner publishes."""

import getpass
import os
import sys
from argparse import SUPPRESS, ArgumentParser
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import urlsplit

from django.core.management import BaseCommand, CommandError

from accounts import audit
from experiments.definition.publication import from_stored
from experiments.deposit.repository import DepositDraft, DepositError, Record, Repository
from experiments.deposit.upload import REPOSITORIES, draft_of, upload_all
from experiments.export.anonymity import sharing_warnings
from experiments.export.archive import zipped
from experiments.export.files import SUMS, export_files
from experiments.extraction.selection import Selection
from experiments.management.study_lookup import study_named
from experiments.models import Study

# Also beside the archive, so that they can be read without unpacking it.
LOOSE = ("README.md", "dataset_description.json", SUMS)
MOST_TITLE = 200


class Command(BaseCommand):
    help = (
        "Upload the pseudonymous dataset of a study to a repository as a draft. The token is read "
        "from ZENODO_TOKEN or OSF_TOKEN, or asked for."
    )

    def add_arguments(self, parser: ArgumentParser) -> None:
        add, flag = parser.add_argument, "store_true"
        add("study", help="name of the study, or name:version")
        add("--to", choices=sorted(REPOSITORIES), required=True, help="the repository")
        add("--sandbox", action=flag, help="the repository's test server")
        add("--url", default="", help="API of another server with the same software")
        add("--new", action=flag, help="make a new draft, even if an earlier run made one")
        add("--by", help=SUPPRESS)  # who does so on the analysis page

    def handle(self, *_args: Any, **options: Any) -> None:
        study = study_named(options["study"])
        kind = REPOSITORIES[options["to"]]
        address = options["url"] or (kind.sandbox if options["sandbox"] else kind.home)
        try:
            repository = kind(address.rstrip("/"), _token(kind))
            draft = self._deposit(study, repository, options)
        except DepositError as error:
            raise CommandError(str(error)) from error
        for warning in sharing_warnings(study):
            self.stdout.write(warning)
        self.stdout.write(f"Not published. Check the draft and publish it there: {draft.url}")

    def _deposit(self, study: Study, repository: Repository, options: Any) -> DepositDraft:
        host = urlsplit(repository.address).netloc
        known = None if options["new"] else study.deposits.get(host)
        earlier = DepositDraft(known["id"], known["url"]) if known else None
        draft = draft_of(repository, _record_of(study), earlier, self.stdout.write)
        deposits = study.deposits | {host: {"id": draft.id, "url": draft.url}}
        Study.objects.filter(pk=study.pk).update(deposits=deposits)
        about = {"study": study.slug, "thing": f"version {study.version}", "detail": draft.url}
        audit.note("study_deposited", actor=options["by"], **about)
        with TemporaryDirectory() as folder:
            files = _written(study, Path(folder))
            upload_all(repository, draft, files, self.stdout.write)
        return draft


def _token(kind: type[Repository]) -> str:
    token = os.environ.get(kind.token, "").strip()
    if not token and sys.stdin.isatty():
        token = getpass.getpass(f"Token for {kind.title}: ").strip()
    if not token or not token.isascii() or not token.isprintable():
        raise CommandError(f"Set {kind.token} to a token of {kind.title} with {kind.scopes}.")
    return token


def _record_of(study: Study) -> Record:
    definition = study.as_definition()
    title = definition.title.get("en") or study.title
    return Record(
        f"{title} (dataset, version {study.version})"[:MOST_TITLE],
        f"Public dataset of the study {study.slug}, version {study.version}, in the "
        "Psych-DS format: driving, events, questionnaires and a code book.",
        from_stored(study.publication),
    )


def _written(study: Study, folder: Path) -> dict[str, Path]:
    """Write the archive of a public export and the files of LOOSE; return paths by name."""
    loose: dict[str, Path] = {}

    def kept() -> Any:
        for name, parts in export_files(study, Selection(public=True)):
            content = parts
            if name in LOOSE:
                content = [b"".join(parts)]
                loose[name] = folder / name
                loose[name].write_bytes(content[0])
            yield name, content

    archive = folder / f"{study.slug}-{study.version}.zip"
    with archive.open("wb") as out:
        out.writelines(zipped(kept()))
    return {**loose, archive.name: archive}
