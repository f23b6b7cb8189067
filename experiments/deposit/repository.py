"""What every repository is to a deposit: a draft that somebody else publishes, and its files."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from experiments.definition.publication import PublicationDetails
from experiments.deposit.client import Progress, RepositoryClient

MOST_NAME = 255  # characters of the name of a file, in both repositories


@dataclass(frozen=True)
class Record:
    """What a draft says of the dataset."""

    title: str
    description: str
    details: PublicationDetails


@dataclass(frozen=True)
class DepositDraft:
    """A draft: its id, and the page on which its owner completes and publishes it."""

    id: str
    url: str


@dataclass(frozen=True)
class StoredFile:
    """A file in a draft; `address` is where a new version of it goes."""

    name: str
    size: int
    md5: str
    address: str


class Repository(ABC):
    """Drafts and files of one repository."""

    title: ClassVar[str]
    home: ClassVar[str]  # address of its API
    sandbox: ClassVar[str]
    token: ClassVar[str]  # the environment variable
    scopes: ClassVar[str]
    domain: ClassVar[str] = ""

    def __init__(self, address: str, token: str) -> None:
        self.client = RepositoryClient(address, token, scopes=self.scopes, domain=self.domain)

    def problems(self, record: Record) -> Iterator[str]:
        """Yield what the repository would refuse."""
        yield from ()

    @abstractmethod
    def create(self, record: Record) -> DepositDraft:
        """Make a draft, which nobody else sees."""

    @abstractmethod
    def update(self, draft: DepositDraft, record: Record) -> None:
        """Let a draft say what is known now.

        Raises:
            NotThereError: somebody has deleted it.
            DepositError: it was published, and cannot be changed.
        """

    @abstractmethod
    def files(self, draft: DepositDraft) -> dict[str, StoredFile]:
        """Return the files that a draft has, by name."""

    @abstractmethod
    def upload(self, draft: DepositDraft, name: str, path: Path, progress: Progress) -> StoredFile:
        """Add a file, or replace the one of that name; return what the repository has then."""
