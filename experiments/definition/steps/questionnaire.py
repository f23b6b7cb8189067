"""Questions about the drive."""

from experiments.definition.step import AskingStep


class QuestionnaireStep(AskingStep, frozen=True, kw_only=True, tag="questionnaire"):
    """Asked after every outcome of a drive."""
