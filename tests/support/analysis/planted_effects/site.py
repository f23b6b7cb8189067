"""The planted studies on a site of its own, played by bots to their end, unattended."""

from collections.abc import Sequence
from pathlib import Path

from experiments.definition.schema import StudyDefinition
from surveys.definition import to_json
from tests.support.analysis.planted_effects.study import planted_questionnaires
from tests.support.sessions.site import Site
from tests.support.studies.short_study import as_json, bots_command

SEED = 5


def play(
    site: Site,
    study: StudyDefinition,
    out: Path,
    *,
    bots: int,
    effects: Sequence[str],
    endings: Sequence[str],
    speed: float,
    within: float,
) -> str:
    """Store a study and its questionnaires in a site's database, let bots take part in a sandbox,
    leave their dataset in a folder, and return what the command printed.
    """
    asked = [to_json(one).decode() for one in planted_questionnaires()]
    site.django(
        "import json; from django.utils import timezone; from experiments import publishing; from"
        " experiments.definition.schema import from_stored; from surveys import questionnaires;"
        " from surveys.problems import parse;"
        f" [questionnaires.store(parse(one.encode()), timezone.now()) for one in {asked!r}];"
        f" publishing.store(from_stored(json.loads({as_json(study)!r})), timezone.now())"
    )
    return bots_command(
        site,
        "run_bots",
        study.slug,
        *(
            "--participants",
            str(bots),
            "--seed",
            str(SEED),
            "--speed",
            str(speed),
            "--at-once",
            "3",
        ),
        *("--endings", ",".join(endings), "--dataset", str(out)),
        *(word for text in effects for word in ("--effect", text)),
        within=within,
    )
