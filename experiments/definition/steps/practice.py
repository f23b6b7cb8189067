"""A free drive."""

from typing import ClassVar

from experiments.definition.step import DriveStep, Minutes


class Practice(DriveStep, frozen=True, kw_only=True, tag="practice"):
    is_practice: ClassVar[bool] = True

    minutes: Minutes = 3.0
