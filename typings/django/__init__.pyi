# What mypy has to know of Django, which has no types: members of TextChoices are text.
from typing import Any

def __getattr__(name: str) -> Any: ...
