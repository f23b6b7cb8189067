"""The profile of the drive page that a visitor gets first. static/js/view/display/profiles.js has
their contents, under the same names.

`standard` is the page as the robot's owner has set it up, the baseline of studies and the profile
of unknown visitors. This app knows no questionnaires; one above it that does registers a rule (in
its AppConfig.ready).
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, get_args

if TYPE_CHECKING:
    from accounts.models import User

Interface = Literal["standard", "novice", "expert", "technical"]
INTERFACES: tuple[Interface, ...] = get_args(Interface)
Rule = Callable[["User"], Interface | None]

_rules: list[Rule] = []


def suggest_by(rule: Rule) -> None:
    """Add a rule; registering twice has no effect."""
    if rule not in _rules:
        _rules.append(rule)


def suggested_to(user: "User") -> Interface | None:
    """Return the suggestion of the first rule that has one for a visitor; None without one."""
    return next((found for rule in _rules if (found := rule(user)) is not None), None)
