"""A study in the database as a dataset, from which tables, figures and exports are made.

Sessions, responses and networks have codes made from the study's secret, participants the random
code that they have; times are seconds since the robot was granted. States and network samples are
read a session at a time, on each call, and events once or, in an export, as they are written.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

from experiments.dataset.columns import Columns
from experiments.dataset.counting import counting, with_reasons
from experiments.dataset.levels import ATTENTION
from experiments.dataset.records import Dataset, FreezeRecord, WholeStudy
from experiments.dataset.states import NO_NETWORK, NO_STATES
from experiments.definition.publication import from_stored
from experiments.extraction.answers import questionnaires_of, responses_of
from experiments.extraction.events import events_of, page_offset
from experiments.extraction.forms import Release
from experiments.extraction.people import Round, pages_of, participants_of
from experiments.extraction.pseudonyms import Pseudonyms
from experiments.extraction.robots import plans_of, robots_of
from experiments.extraction.selection import Selection
from experiments.extraction.sessions import drives_of, granted, sessions_of
from experiments.extraction.states import network_of, states_of
from experiments.models import Drive, Participant, ParticipantKind, Study
from experiments.versions import software_version

ANALYSED = Selection(sources=("task",))  # tables and figures need no other events


def dataset_of(
    study: Study, *, choice: Selection = ANALYSED, drives: Sequence[Drive] | None = None
) -> Dataset:
    """Return the records of one version of a study, as far as `choice` has them. A caller that has
    its `drives` reads their events by itself, so the dataset then has none.
    """
    release, definition = release_of(study, choice), study.as_definition()
    names = release.names
    with_events = drives is None
    drives = list(drives_of(study, choice)) if drives is None else drives
    sessions = sessions_of(study, drives, release)
    # the last session of a round: practice comes before the task, and a participant may have had to
    # start again
    places: dict[Round, str] = {
        (one.participant_id, one.visit, one.round): names.session(one.session_id) for one in drives
    }
    found = Dataset(
        study=definition,
        robots=robots_of(definition, (one.robot for one in sessions)),
        participants=tuple(participants_of(study, drives, choice)),
        sessions=tuple(sessions),
        events=tuple(events_of(drives, release)) if with_events else (),
        pages=tuple(pages_of(study, places, choice)),
        responses=tuple(responses_of(study, places, names, choice)),
        questionnaires=questionnaires_of(study),
        plans=plans_of(definition),
        states=_reader(drives, names, _states, NO_STATES),
        freeze=freeze_of(study),
        network=_reader(drives, names, _network, NO_NETWORK),
        publication=from_stored(study.publication),
    )
    if choice.public:
        found = replace(found, whole=_whole_of(study, {one.id for one in found.participants}))
    return with_reasons(found)


def _whole_of(study: Study, published: set[str]) -> WholeStudy:
    whole = dataset_of(study, drives=list(drives_of(study, ANALYSED)))
    excluded = tuple(
        # the given answer may be one that a public dataset withholds
        replace(one, value="") if one.rule == ATTENTION else one
        for kind in sorted({one.kind for one in whole.participants})
        for one in counting(whole, [kind]).exclusions
        if one.participant in published and not one.session
    )
    withdrew = Counter(one.kind for one in whole.participants if one.withdrawn)
    staying = Counter(one.kind for one in whole.participants if not one.withdrawn)
    return WholeStudy(staying["participant"], withdrew, excluded)


def release_of(study: Study, choice: Selection) -> Release:
    definition = study.as_definition()
    plans = plans_of(definition).values()
    doors = frozenset(opening.name for plan in plans for opening in plan.openings)
    script = definition.wizard.steps if definition.wizard is not None else ()
    return Release(Pseudonyms(study.secret), choice, doors, frozenset(step.key for step in script))


def freeze_of(study: Study) -> FreezeRecord:
    at = study.published_at
    about = {"sha256": study.sha256, "deviations": study.deviations}
    if at is not None:
        people = Participant.objects.filter(study__slug=study.slug, created_at__lt=at)
        people = people.filter(kind=ParticipantKind.PARTICIPANT)
        about |= {
            "frozen_at": f"{at:%Y-%m-%d %H:%M} UTC",
            "before_data": not people.filter(study=study).exists(),
            "earlier": people.filter(study__version__lt=study.version).count(),
        }
    return FreezeRecord(**about, software=software_version())


def _states(drive: Drive) -> Columns:
    return states_of(drive.session_id, granted(drive))


def _network(drive: Drive) -> Columns:
    return network_of(drive.session_id, granted(drive), page_offset(drive.session_id))


def _reader(
    drives: Sequence[Drive], names: Pseudonyms, read: Callable[[Drive], Columns], nothing: Columns
) -> Callable[[str], Columns]:
    """Return a function of a session's code, which caches its last result."""
    known = {names.session(drive.session_id): drive for drive in drives}

    @lru_cache(maxsize=1)
    def found(session: str) -> Columns:
        drive = known.get(session)
        return nothing if drive is None else read(drive)

    return found
