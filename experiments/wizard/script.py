"""The script of a study as an operator's page gets it, in one language: pure."""

from typing import Any

from experiments.definition.wizard import (
    DockMove,
    DriveMove,
    Move,
    PlaceMove,
    TiltMove,
    TurnMove,
    Wizard,
    WizardStep,
)
from sessions.wizard.script import Script, ScriptStage, ScriptStep, TimedDrive
from surveys.documents import spoken


def script_of(wizard: Wizard, *, shown_in: str, spoken_in: str) -> Script:
    """Return a script; titles are in the operator's language, lines in the participant's."""
    return Script(
        language=spoken_in,
        stages=tuple(
            ScriptStage(
                key=stage.key,
                title=spoken(stage.title, shown_in)[:120],
                steps=tuple(_step(step, shown_in, spoken_in) for step in stage.steps),
            )
            for stage in wizard.stages
        ),
        is_ordered=wizard.order == "stages",
        by_hand=wizard.by_hand,
        participant_view=wizard.participant_view,
    )


def _step(step: WizardStep, shown_in: str, spoken_in: str) -> ScriptStep:
    fields: dict[str, Any] = {"text": spoken(step.line, spoken_in), "aloud": step.aloud}
    return ScriptStep(
        key=step.key,
        title=spoken(step.title, shown_in)[:120],
        shortcut=step.shortcut,
        within=step.within,
        **(fields if step.move is None else _move(step.move)),
    )


def _move(move: Move) -> dict[str, Any]:
    match move:
        case PlaceMove(name=name):
            return {"action": "goto", "place": name}
        case TiltMove(angle=angle):
            return {"action": "tilt", "angle": angle}
        case TurnMove(angle=angle):
            return {"turn": angle}
        case DriveMove(linear=linear, angular=angular, seconds=seconds):
            return {"drive": TimedDrive(linear=linear, angular=angular, seconds=seconds)}
        case _:
            return {"action": "dock" if isinstance(move, DockMove) else "undock"}
