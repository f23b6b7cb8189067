"""A deposit: a new draft or that of an earlier run, to which each file is sent unless it has it
already; size and checksum are compared with those in the repository.
"""

from collections.abc import Mapping
from functools import partial
from hashlib import file_digest, md5
from pathlib import Path

from experiments.definition.publication import is_address
from experiments.deposit.osf import Osf
from experiments.deposit.repository import (
    DepositDraft,
    DepositError,
    NotThereError,
    Record,
    Repository,
    Tell,
    megabytes,
)
from experiments.deposit.zenodo import Zenodo

MAX_NAME = 255  # characters of the name of a file, in both repositories
REPOSITORIES: Mapping[str, type[Repository]] = {"osf": Osf, "zenodo": Zenodo}


def draft_of(
    repository: Repository, record: Record, known: DepositDraft | None, tell: Tell
) -> DepositDraft:
    """Return the draft of an earlier run, or a new one; a refusal is a DepositError."""
    problems = list(repository.problems(record))
    if problems:
        raise DepositError(f"{' '.join(problems)} Fill in the publication details of the study.")
    if known is not None:
        try:
            repository.update(known, record)
        except NotThereError:
            tell(f"The draft {known.url} was deleted. Making a new one.")
        else:
            tell(f"Draft of an earlier run: {known.url}")
            return known
    draft = repository.create(record)
    if not is_address(draft.url):
        raise DepositError(f"{repository.title} gave no address for the draft.")
    tell(f"New draft: {draft.url}")
    return draft


def upload_all(
    repository: Repository, draft: DepositDraft, files: Mapping[str, Path], tell: Tell
) -> None:
    """Send files by the names that they have in the repository. If one is refused or arrives with a
    difference, raise DepositError; those before it are stored.
    """
    for name in files:
        if len(name) > MAX_NAME:
            raise DepositError(f"{name[:40]}… is longer than {MAX_NAME} characters.")
    there = repository.files(draft)
    for name, path in files.items():
        with path.open("rb") as file:
            checksum = file_digest(file, partial(md5, usedforsecurity=False)).hexdigest()
        size = path.stat().st_size
        known = there.get(name)
        if known is not None and (known.size, known.md5) == (size, checksum):
            tell(f"{name}: already there, {megabytes(size)}")
            continue
        stored = repository.upload(draft, name, path, tell)
        if stored.size != size:
            text = f"{name} has {stored.size} bytes there and {size} here."
            raise DepositError(f"{text} Run it again to replace it.")
        if stored.md5 != checksum:
            text = f"{name} has a different checksum there. Run it again to replace it."
            raise DepositError(text)
        tell(f"{name}: {'replaced' if known else 'sent'} and compared, {megabytes(size)}")
