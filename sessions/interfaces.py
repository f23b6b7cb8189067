"""Which profile of the drive page somebody is offered first. What each shows stands in
static/js/view/display/profiles.js, under the same names.

`standard` is the page as a robot's owner has set it up: what a study compares with, and what a
visitor gets of whom nothing is known. This app knows no questionnaires; one above it that does
registers a rule (in its AppConfig.ready).
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
    """Have a rule asked from now on; registering twice does nothing."""
    if rule not in _rules:
        _rules.append(rule)


def suggested_to(user: "User") -> Interface | None:
    """Return what the first rule with an opinion suggests to a visitor; None when
    nobody has one.
    """
    return next((found for rule in _rules if (found := rule(user)) is not None), None)
