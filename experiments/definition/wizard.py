"""The hidden operator of a study ("Wizard of Oz", Kelley 1984; Riek 2012), who drives and speaks
for the robot by a script while the participant believes that it acts by itself. Metres, radians,
m/s, rad/s, seconds.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Literal

from msgspec import Meta

from experiments.definition.design import TitledPart
from robots.api.floorplan import Key as PlanKey
from robots.api.messages import Capability
from surveys.documents import (
    DocumentPart,
    Key,
    Problem,
    ProblemPlace,
    Text,
    duplicates,
    gettext_noop as _,
    within,
)

MOST_DRIVE_SECONDS = 10.0
DRIVING_KEYS = frozenset("wasd")  # by hand, on the operator's page
LONGEST_LINE = 500  # characters of robots.api.messages.Say

Shortcut = Annotated[str, Meta(pattern=r"^[0-9a-z]?$")]


class PlaceMove(DocumentPart, frozen=True, kw_only=True, tag_field="kind", tag="place"):
    name: PlanKey  # of a place of the site


class DockMove(DocumentPart, frozen=True, kw_only=True, tag_field="kind", tag="dock"):
    """The robot returns to its charging station."""


class UndockMove(DocumentPart, frozen=True, kw_only=True, tag_field="kind", tag="undock"):
    """The robot leaves its charging station."""


class TiltMove(DocumentPart, frozen=True, kw_only=True, tag_field="kind", tag="tilt"):
    angle: Annotated[float, Meta(ge=-1.6, le=1.6)]  # positive: the head looks down


class TurnMove(DocumentPart, frozen=True, kw_only=True, tag_field="kind", tag="turn"):
    angle: Annotated[float, Meta(ge=-3.15, le=3.15)] = 3.14  # positive: counter-clockwise


class DriveMove(DocumentPart, frozen=True, kw_only=True, tag_field="kind", tag="drive"):
    # within the limits of robot and condition
    linear: Annotated[float, Meta(ge=-2.0, le=2.0)] = 0.0
    angular: Annotated[float, Meta(ge=-3.0, le=3.0)] = 0.0
    seconds: Annotated[float, Meta(gt=0.0, le=MOST_DRIVE_SECONDS)]


Move = PlaceMove | DockMove | UndockMove | TiltMove | TurnMove | DriveMove
NEEDS: Mapping[type, Capability] = {
    PlaceMove: "goto",
    DockMove: "dock",
    UndockMove: "undock",
    TiltMove: "tilt",
    TurnMove: "velocity",
    DriveMove: "velocity",
}


class WizardStep(TitledPart, frozen=True, kw_only=True):
    """A button of the operator's page: the robot says a `line` (`aloud`, or only on its screen) or
    makes a `move`. `shortcut` is its key. It is recorded as late more than `within` seconds after
    the step before it, or after the start of the session.
    """

    shortcut: Shortcut = ""
    line: Text = {}
    aloud: bool = True
    move: Move | None = None
    within: Annotated[float, Meta(gt=0.0, le=3600.0)] | None = None


class WizardStage(TitledPart, frozen=True, kw_only=True):
    steps: Annotated[tuple[WizardStep, ...], Meta(max_length=60)] = ()


class Wizard(DocumentPart, frozen=True, kw_only=True):
    """The hidden operator drives in `conditions` (empty: in all). A `blind` operator is not shown
    the condition, `participant_view` shows the cue on the participant's page, and `by_hand` lets
    the operator drive with the keys. `order`: steps in another order than that of the `stages` are
    deviations, or any order is right (`free`).
    """

    conditions: tuple[Key, ...] = ()
    blind: bool = False
    participant_view: bool = False
    by_hand: bool = True
    order: Literal["stages", "free"] = "stages"
    stages: Annotated[tuple[WizardStage, ...], Meta(max_length=20)] = ()

    def drives_in(self, condition: str) -> bool:
        return not self.conditions or condition in self.conditions

    @property
    def steps(self) -> tuple[WizardStep, ...]:
        return tuple(step for stage in self.stages for step in stage.steps)


def problems(
    wizard: Wizard, conditions: Sequence[str], languages: Sequence[str], *, is_debriefed: bool
) -> Iterator[Problem]:
    """Yield the problems of a script; `is_debriefed`: the debriefing tells of the operator."""
    if not is_debriefed:
        words = _(
            "The debriefing must tell participants that an operator drove the robot: add a debrief "
            "step with an `operator` text."
        )
        yield Problem(words, place=ProblemPlace("steps"))
    found = _of_whole(wizard, conditions)
    yield from within(found, ProblemPlace("wizard"), _("Hidden operator"))
    for n, stage in enumerate(wizard.stages):
        for step in stage.steps:
            found = _of_step(step, languages)
            yield from within(found, ProblemPlace("stages", n), _("Script step"), step.key)


def _of_whole(wizard: Wizard, conditions: Sequence[str]) -> Iterator[Problem]:
    for key in wizard.conditions:
        if key not in conditions:
            yield Problem(_("there is no condition %(key)s."), {"key": key})
    if not wizard.steps and not wizard.by_hand:
        yield Problem(_("the script has no step and driving by hand is off: add a step."))
    yield from duplicates(_("Stage"), (stage.key for stage in wizard.stages))
    yield from duplicates(_("Step"), (step.key for step in wizard.steps))
    keys = (step.shortcut for step in wizard.steps if step.shortcut)
    yield from duplicates(_("Key"), keys)


def _of_step(step: WizardStep, languages: Sequence[str]) -> Iterator[Problem]:
    if bool(step.line) == (step.move is not None):
        yield Problem(_("it needs either a line or a move."))
    if step.shortcut in DRIVING_KEYS:
        words = _("the key %(key)s drives the robot; choose another one.")
        yield Problem(words, {"key": step.shortcut})
    if step.line and any(len(step.line.get(one, "")) > LONGEST_LINE for one in languages):
        yield Problem(_("the line is longer than %(n)d characters."), {"n": LONGEST_LINE})
    if isinstance(step.move, DriveMove) and not (step.move.linear or step.move.angular):
        yield Problem(_("the robot would drive at no speed."))


def obstacles(
    wizard: Wizard, places: frozenset[str], capabilities: frozenset[str]
) -> Iterator[Problem]:
    for step in wizard.steps:
        if isinstance(step.move, PlaceMove) and step.move.name not in places:
            words = _("the script's step %(key)s goes to %(place)s, which is not a place there.")
            yield Problem(words, {"key": step.key, "place": step.move.name})
        need: Capability = "say" if step.move is None else NEEDS[type(step.move)]
        if need not in capabilities:
            words = _("the robot cannot do the script's step %(key)s (%(need)s).")
            yield Problem(words, {"key": step.key, "need": need})
