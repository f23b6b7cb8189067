"""The planted study on a site of its own, played by bots to its end, unattended."""

import json
from pathlib import Path

import msgspec

from surveys.definition import to_json
from tests.support.analysis.planted_effects.study import (
    EFFECTS,
    SLUG,
    planted_questionnaires,
    planted_study,
)
from tests.support.sessions.site import Site
from tests.support.studies.short_study import as_json, bots_command

SEED = 5


def store_planted(site: Site) -> None:
    """Put the study and its questionnaires into a site's database, as a draft."""
    asked = [to_json(one).decode() for one in planted_questionnaires()]
    site.django(
        "import json; from django.utils import timezone; from experiments import publishing; from"
        " experiments.definition.schema import from_stored; from surveys import questionnaires;"
        " from surveys.problems import parse;"
        f" [questionnaires.store(parse(one.encode()), timezone.now()) for one in {asked!r}];"
        f" publishing.store(from_stored(json.loads({as_json(planted_study())!r})), timezone.now())"
    )


def play_planted(site: Site, out: Path, *, bots: int, speed: float, within: float) -> str:
    """Let bots take part in a sandbox, leave their dataset in a folder, and return what was
    said.
    """
    effects = [word for text in EFFECTS for word in ("--effect", text)]
    return bots_command(
        site,
        "run_bots",
        SLUG,
        *("--participants", str(bots), "--seed", str(SEED), "--speed", str(speed)),
        *("--endings", "completes", "--at-once", "3", "--dataset", str(out)),
        *effects,
        within=within,
    )
