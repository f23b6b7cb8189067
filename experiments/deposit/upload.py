"""A deposit from beginning to end: a draft is made or found again, and each file is sent unless it
is there, and compared by size and checksum with what the repository has.
"""

from collections.abc import Callable, Mapping
from hashlib import md5
from pathlib import Path

from experiments.definition.publication import is_address
from experiments.deposit.client import DepositError, NotThereError, Progress
from experiments.deposit.osf import Osf
from experiments.deposit.repository import MOST_NAME, DepositDraft, Record, Repository, StoredFile
from experiments.deposit.zenodo import Zenodo

REPOSITORIES: Mapping[str, type[Repository]] = {"osf": Osf, "zenodo": Zenodo}
PART = 1 << 20
STEPS = 10  # how often progress is told for a file
Tell = Callable[[str], None]


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
        size, checksum = path.stat().st_size, checksum_of(path)
        known = there.get(name)
        if known is not None and (known.size, known.md5) == (size, checksum):
            tell(f"{name}: already there, {_megabytes(size)}")
            continue
        stored = repository.upload(draft, name, path, _progress(name, size, tell))
        _compare(stored, name, size, checksum)
        tell(f"{name}: {'replaced' if known else 'sent'} and compared, {_megabytes(size)}")


def _compare(stored: StoredFile, name: str, size: int, checksum: str) -> None:
    if stored.size != size:
        raise DepositError(
            f"{name} has {stored.size} bytes there and {size} here. Run it again to replace it."
        )
    if stored.md5 != checksum:
        raise DepositError(f"{name} has a different checksum there. Run it again to replace it.")


def checksum_of(path: Path) -> str:
    """Return the MD5 of a file, by which both repositories compare."""
    found = md5(usedforsecurity=False)
    with path.open("rb") as file:
        while part := file.read(PART):
            found.update(part)
    return found.hexdigest()


def _progress(name: str, size: int, tell: Tell) -> Progress:
    told = 0

    def progress(sent: int) -> None:
        nonlocal told
        step = sent * STEPS // size if size else STEPS
        if told < step < STEPS and size > PART:
            tell(f"{name}: {step * 100 // STEPS} % of {_megabytes(size)}")
        told = max(told, step)

    return progress


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.2f} MB"
