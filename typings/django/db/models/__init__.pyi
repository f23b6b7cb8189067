from enum import Enum, EnumMeta
from typing import Any

class ChoicesType(EnumMeta):
    choices: Any
    labels: Any
    names: Any
    values: Any

class TextChoices(str, Enum, metaclass=ChoicesType):  # type: ignore[misc] # noqa: UP042 -- as Django
    @property
    def label(self) -> str: ...

def __getattr__(name: str) -> Any: ...
