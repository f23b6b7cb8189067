"""What every file format of another survey system says of itself."""

from dataclasses import dataclass
from typing import ClassVar

from surveys.importing.draft import Draft


@dataclass(frozen=True)
class Wishes:
    """What the file may not say. `language` is that of texts whose language the file does not name;
    `form` names the one form to take of a file with several.
    """

    language: str = "en"
    form: str = ""


class SurveyFormat:
    """A file format; one subclass a module of `surveys.importing.formats`."""

    # The product and its file, as its users call them.
    label: ClassVar[str]

    @classmethod
    def is_in(cls, document: bytes) -> bool:
        """Tell by its beginning whether a file is of this format."""
        raise NotImplementedError

    @classmethod
    def read(cls, document: bytes, wishes: Wishes, /) -> Draft:
        """Return what a file asks.

        Raises:
            BadDefinitionError: it cannot be read at all.
        """
        raise NotImplementedError
