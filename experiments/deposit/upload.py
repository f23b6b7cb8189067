"""A deposit: a draft is made or found again, and each file is sent unless it is there, and compared
by size and checksum with what the repository has.
"""

from collections.abc import Mapping
from functools import partial
from hashlib import file_digest, md5
from pathlib import Path

from experiments.definition.publication import is_address
from experiments.deposit.osf import Osf
from experiments.deposit.repository import (
    MOST_NAME,
    DepositDraft,
    DepositError,
    NotThereError,
    Record,
    Repository,
    Tell,
    megabytes,
)
from experiments.deposit.zenodo import Zenodo

REPOSITORIES: Mapping[str, type[Repository]] = {"osf": Osf, "zenodo": Zenodo}


def draft_of(
    repository: Repository, record: Record, known: DepositDraft | None, tell: Tell
) -> DepositDraft:
    """Return the draft of an earlier run, or a new one.

    Raises:
        DepositError: it cannot be made or changed.
    """
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
    """Send files by the names that they have there.

    Raises:
        DepositError: one was refused or has not arrived as it is here; those before are there.
    """
    for name in files:
        if len(name) > MOST_NAME:
            raise DepositError(f"{name[:40]}… is longer than {MOST_NAME} characters.")
    there = repository.files(draft)
    for name, path in files.items():
        size, checksum = path.stat().st_size, _checksum_of(path)
        known = there.get(name)
        if known is not None and (known.size, known.md5) == (size, checksum):
            tell(f"{name}: already there, {megabytes(size)}")
            continue
        stored = repository.upload(draft, name, path, tell)
        if stored.size != size:
            raise DepositError(
                f"{name} has {stored.size} bytes there and {size} here. Run it again to replace it."
            )
        if stored.md5 != checksum:
            raise DepositError(
                f"{name} has a different checksum there. Run it again to replace it."
            )
        tell(f"{name}: {'replaced' if known else 'sent'} and compared, {megabytes(size)}")


def _checksum_of(path: Path) -> str:
    """Return the MD5 of a file, by which both repositories compare."""
    with path.open("rb") as file:
        return file_digest(file, partial(md5, usedforsecurity=False)).hexdigest()
