"""What was decided is written down: a stored definition with every value, each draw of a cell as a
row, and when participants first saw the robot's video.

Until now a definition left out what was so by default. It gets the values that were in force, which
stand here and not in the classes: later releases may have others. The digest of a published version
stays, because it may be printed somewhere; it was made of the definition without these values.
"""

from collections.abc import Iterator
from copy import deepcopy
from datetime import UTC, datetime
from hashlib import sha256
from typing import Any

import msgspec
from django.db import migrations

# The values by default of each class of a definition, and the classes of its parts.
CLASSES: dict[str, tuple[dict[str, Any], dict[str, str]]] = {'StudyDefinition': ({'intro': {},
                      'source': '',
                      'licence': '',
                      'recruitment': '',
                      'compensation': '',
                      'turned_away_code': False,
                      'observers_allowed': False,
                      'factors': [],
                      'allocation': {},
                      'refill': {},
                      'start': {},
                      'quality': {},
                      'analysis': {},
                      'analyses': [],
                      'wizard': None,
                      'plan': None,
                      'coding': None,
                      'recruiting': None,
                      'devices': [],
                      'browsers': [],
                      'screening': [],
                      'answer_quotas': [],
                      'appointments': None},
                     {'steps': 'step',
                      'factors': 'Factor',
                      'conditions': 'Condition',
                      'courses': 'Course',
                      'allocation': 'Allocation',
                      'refill': 'Refill',
                      'start': 'Start',
                      'quality': 'Quality',
                      'analysis': 'Analysis',
                      'analyses': 'DeclaredAnalysis',
                      'wizard': 'Wizard',
                      'plan': 'StudyPlan',
                      'coding': 'CodingScheme',
                      'recruiting': 'Recruiting',
                      'screening': 'AnswerRule',
                      'answer_quotas': 'AnswerQuota',
                      'appointments': 'Appointments'}),
 'step consent': ({'repeat': False,
                   'version': 1,
                   'sharing': {},
                   'minimum_age': 18,
                   'minors': 'refused'},
                  {}),
 'step debrief': ({'repeat': False, 'operator': {}}, {}),
 'step form': ({'repeat': False, 'version': 1}, {}),
 'step instructions': ({'repeat': False}, {'leaves': 'InstructionPage'}),
 'InstructionPage': ({'picture': None, 'robot': [], 'conditions': []}, {}),
 'step practice': ({'repeat': False, 'minutes': 3.0}, {}),
 'step questionnaire': ({'repeat': False, 'version': 1}, {}),
 'step task': ({'repeat': False, 'minutes': 15.0, 'last_minutes': 2.0, 'docked_seconds': 2.0},
               {}),
 'Factor': ({'design': 'between', 'changes': [], 'levels': []}, {'levels': 'Level'}),
 'Level': ({'sets': {}}, {'sets': 'LevelSettings'}),
 'LevelSettings': ({'video_delay': None,
                    'video_jitter': None,
                    'video_loss': None,
                    'control_delay': None,
                    'control_jitter': None,
                    'control_loss': None,
                    'assist': None,
                    'interface': None,
                    'controllers': None,
                    'actions': None,
                    'control_way': None,
                    'linear': None,
                    'angular': None,
                    'doors_closed': None,
                    'robot': None,
                    'site': None},
                   {}),
 'Condition': ({'levels': {},
                'access': 'open',
                'control_way': 'any',
                'actions': [],
                'assist': 'off',
                'interface': 'standard',
                'speed': {},
                'doors_closed': [],
                'network': {},
                'idle_seconds': None},
               {'speed': 'SpeedChoice', 'network': 'Network'}),
 'SpeedChoice': ({'linear': None, 'angular': None}, {}),
 'Network': ({'control': None, 'video': None},
             {'control': 'Impairment', 'video': 'Impairment'}),
 'Impairment': ({'delay': 0.0, 'jitter': 0.0, 'loss': 0.0, 'reorder': 0.0, 'bitrate': None},
                {}),
 'Course': ({'dock': '', 'path': [], 'doors': [], 'zones': [], 'photo': None},
            {'checkpoints': 'StudyCheckpoint', 'zones': 'Zone', 'photo': 'PhotoTask'}),
 'StudyCheckpoint': ({'radius': 0.6, 'title': {}}, {}),
 'Zone': ({}, {}),
 'PhotoTask': ({'radius': 1.5, 'view': 0.6}, {}),
 'Allocation': ({'design': 'between',
                 'order': 'balanced',
                 'quota': None,
                 'left_after_hours': 24.0,
                 'best_probability': 1.0,
                 'balancing': 'minimization',
                 'balance': []},
                {'balance': 'BalanceFactor'}),
 'BalanceFactor': ({'limits': []}, {}),
 'Refill': ({'outcomes': [], 'most': 0}, {}),
 'Start': ({'docked': True, 'distance': 0.3, 'heading': 0.35, 'charge': 0.0}, {}),
 'Quality': ({'least_sample_rate': 3.5,
              'longest_gap': 2.0,
              'largest_clock_offset': 0.25,
              'condition_applied': True,
              'operator_absent': True},
             {}),
 'Analysis': ({'drives': 'all', 'counts': 'first', 'interval': 't', 'statements': 'experience'},
              {}),
 'DeclaredAnalysis': ({'measures': [],
                       'test': 'means',
                       'contrasts': [],
                       'conditions': [],
                       'post_hoc': False,
                       'effects': [],
                       'covariates': [],
                       'coding': 'treatment'},
                      {'contrasts': 'Contrast'}),
 'Contrast': ({}, {}),
 'Wizard': ({'conditions': [],
             'blind': False,
             'participant_view': False,
             'by_hand': True,
             'order': 'stages',
             'stages': []},
            {'stages': 'WizardStage'}),
 'WizardStage': ({'steps': []}, {'steps': 'WizardStep'}),
 'WizardStep': ({'shortcut': '', 'line': {}, 'aloud': True, 'move': None, 'within': None},
                {'move': 'move'}),
 'move place': ({}, {}),
 'move dock': ({}, {}),
 'move undock': ({}, {}),
 'move tilt': ({}, {}),
 'move turn': ({'angle': 3.14}, {}),
 'move drive': ({'linear': 0.0, 'angular': 0.0}, {}),
 'StudyPlan': ({'question': '',
                'hypotheses': [],
                'families': [],
                'alpha': 0.05,
                'attention_checks': [],
                'speeders': [],
                'incomplete': 'keep',
                'faults': [],
                'participants': None,
                'rationale': '',
                'stopping': '',
                'power': 0.8,
                'expected': [],
                'blinding': '',
                'missing_data': '',
                'notes': ''},
               {'hypotheses': 'Hypothesis',
                'families': 'HypothesisFamily',
                'attention_checks': 'AttentionCheck',
                'speeders': 'Speeder',
                'expected': 'ExpectedEffect'}),
 'Hypothesis': ({'text': '',
                 'direction': 'different',
                 'analysis': '',
                 'measures': [],
                 'contrast': None,
                 'effect': ''},
                {}),
 'HypothesisFamily': ({'hypotheses': []}, {}),
 'AttentionCheck': ({'answer': ''}, {}),
 'Speeder': ({'seconds': None, 'median_share': None}, {}),
 'ExpectedEffect': ({'condition': '',
                     'difference': 0.0,
                     'level': None,
                     'sd': None,
                     'correlation': None},
                    {}),
 'CodingScheme': ({'blind': False, 'bin': 1.0, 'tolerance': 0.5}, {'codes': 'Code'}),
 'Code': ({'key': '', 'description': '', 'group': '', 'modifiers': []},
          {'modifiers': 'Modifier'}),
 'Modifier': ({}, {}),
 'Recruiting': ({'site': 'any',
                 'id_parameter': '',
                 'return_address': '',
                 'returning': [],
                 'codes': {}},
                {'codes': 'EndingCodes'}),
 'EndingCodes': ({'done': '',
                  'timed_out': '',
                  'technical_failure': '',
                  'screened_out': '',
                  'left': ''},
                 {}),
 'AnswerRule': ({'answers': [], 'at_least': None, 'at_most': None}, {}),
 'AnswerQuota': ({'answers': [], 'most': 10}, {}),
 'Appointments': ({'required': True,
                   'minutes': 30,
                   'days_ahead': 14,
                   'reminder_hours': 24.0,
                   'second_after_days': None},
                  {})}


def completed(part: dict[str, Any], name: str = "StudyDefinition") -> dict[str, Any]:
    """Return a part of a stored definition with every value; `name` is that of its class, without
    the kind where its `kind` says it.
    """
    if name not in CLASSES:
        name = f"{name} {part['kind']}"
    defaults, parts = CLASSES[name]
    whole = deepcopy(defaults) | part
    for field, inner in parts.items():
        if isinstance(whole[field], list):
            whole[field] = [completed(one, inner) for one in whole[field]]
        elif whole[field] is not None:
            whole[field] = completed(whole[field], inner)
    return whole


def digest_of(definition: dict[str, Any]) -> str:
    """Return the SHA-256 of a definition with every value."""
    return sha256(msgspec.json.encode(definition, order="deterministic")).hexdigest()


def complete_definitions(apps: Any, _schema_editor: Any) -> None:
    """Complete what is stored. The digest of a draft follows, and that of its rehearsals, which
    were of the same definition.
    """
    rehearsals = apps.get_model("experiments", "Rehearsal").objects
    for study in apps.get_model("experiments", "Study").objects.iterator():
        study.definition = completed(study.definition)
        if study.status == "draft":
            before, study.sha256 = study.sha256, digest_of(study.definition)
            rehearsals.filter(study=study.pk, sha256=before).update(sha256=study.sha256)
        study.save(update_fields=["definition", "sha256"])


def complete_drives(apps: Any, _schema_editor: Any) -> None:
    """Complete what was assigned, and note when the video was first shown: the page has told, and
    robots that move were seen.
    """
    frames: dict[object, float] = {}
    events = apps.get_model("telepresence_sessions", "SessionEvent").objects
    told = events.filter(source="page", type="first_frame", session__drive__isnull=False)
    for session, at in told.values_list("session_id", "received_at").iterator():
        frames[session] = min(at, frames.get(session, at))
    drives = apps.get_model("experiments", "Drive").objects.select_related("session")
    for drive in drives.iterator():
        for name, kind in (("condition", "Condition"), ("start", "Start")):
            if drive.assigned.get(name) is not None:
                drive.assigned[name] = completed(drive.assigned[name], kind)
        at = frames.get(drive.session_id, (drive.result or {}).get("started"))
        if at is not None:
            drive.exposed_at = datetime.fromtimestamp(at, UTC)
        elif drive.moved or drive.session.first_motion_at is not None:
            drive.exposed_at = drive.session.first_motion_at or drive.granted_at
        drive.save(update_fields=["assigned", "exposed_at"])


def write_draws(apps: Any, _schema_editor: Any) -> None:
    """Write the last draw of each participant as a row; earlier ones were not kept."""
    participants = apps.get_model("experiments", "Participant").objects
    draws = apps.get_model("experiments", "Draw").objects
    for study in apps.get_model("experiments", "Study").objects.only("pk").iterator():
        for kind in ("participant", "pilot", "bot"):
            assigned = participants.filter(study=study.pk, kind=kind).exclude(cell="")
            for number, row in _numbered(list(assigned)):
                draws.create(
                    study_id=study.pk,
                    participant=row,
                    kind=kind,
                    number=number,
                    nth=1,
                    reason="first",
                    cell=row.cell,
                    best=row.candidates,
                    seed=row.draw_seed,
                    at=row.assigned_at,
                )
            assigned.update(draws_applied=1)


def _numbered(rows: list[Any]) -> Iterator[tuple[int, Any]]:
    """Yield the rows of a study and kind by the number of their draw; those without one are last."""
    known = {row.pk: _number(row.drawn_as) for row in rows}
    rest = max(known.values(), default=0)
    for row in sorted(rows, key=lambda row: (known[row.pk] == 0, known[row.pk])):
        rest += known[row.pk] == 0
        yield known[row.pk] or rest, row


def _number(word: str) -> int:
    number = word.rpartition(":")[2]
    return int(number) if ":" in word and number.isdecimal() else 0


class Migration(migrations.Migration):
    dependencies = [
        ("experiments", "0017_draws_and_exposure"),
        ("telepresence_sessions", "0001_squashed_0013_states_in_order"),
    ]

    operations = [
        migrations.RunPython(one, migrations.RunPython.noop)
        for one in (complete_definitions, complete_drives, write_draws)
    ]
