"""The words of the study builder: labels and hints of fields, and what can be chosen."""

from typing import TypeAlias

from django.utils.functional import Promise
from django.utils.text import capfirst
from django.utils.translation import gettext_lazy as _
from django.utils.translation import gettext_lazy as translated
from django.utils.translation import pgettext_lazy

from experiments.definition.coding import CodingScheme
from experiments.definition.factors import SETTING_NAMES
from experiments.definition.plan import Hypothesis
from experiments.definition.schema import Condition, StudyCheckpoint
from experiments.definition.step import AskingStep
from experiments.definition.wizard import Wizard, WizardStep
from experiments.recruitment.sites import PROFILES
from surveys.document_forms.guide import FormGuide
from surveys.editor.labels import CHOICES as SURVEY_CHOICES
from surveys.editor.labels import LABELS as SURVEY_LABELS

Words: TypeAlias = str | Promise
# Settings without a button for a new factor.
RARE_FACTORS = frozenset({"video_jitter", "control_jitter", "control_way", "angular"})
SETTINGS = {name: capfirst(translated(words)) for name, words in SETTING_NAMES.items()}
FACTORS = {name: words for name, words in SETTINGS.items() if name not in RARE_FACTORS}
ENDING_NAMES: dict[str, Words] = {
    "done": _("completed"),
    "timed_out": _("time ran out"),
    "technical_failure": _("ended by a technical failure"),
    "screened_out": _("turned away"),
    "left": _("left early"),
}

LABELS: dict[str, Words] = {
    **{key: SURVEY_LABELS[key] for key in ("title", "intro", "source", "licence", "languages")},
    "key": _("Short name"),
    "repeat": _("Once for each condition"),
    "text": _("Text"),
    "sharing": _("Agreement to publishing"),
    "version": _("Version"),
    "minimum_age": _("Minimum age"),
    "minors": _("Below this age"),
    "questionnaire": _("Questionnaire"),
    "leaves": _("Pages"),
    "picture": _("Illustration"),
    "robot": _("Robot"),
    "minutes": _("Time limit (minutes)"),
    "last_minutes": _("Show time left in the last (minutes)"),
    "docked_seconds": _("Charger contact that counts as docked (s)"),
    "site": pgettext_lazy("a building", "Site"),
    "access": _("Eligible participants"),
    "control_way": _("Command channel"),
    "controllers": _("Input devices"),
    "actions": _("Actions the robot may be given"),
    "assist": _("Assistance"),
    "interface": _("Interface"),
    "speed": _("Speed limits"),
    "linear": _("Speed (m/s)"),
    "angular": _("Turning speed (°/s)"),
    "doors_closed": _("Closed doors"),
    "network": _("Network"),
    "idle_seconds": _("Ask “Are you still there?” after (s)"),
    "control": _("Impairment towards the robot"),
    "video": _("Impairment from the camera"),
    "delay": _("Delay (s)"),
    "jitter": _("Jitter (s)"),
    "loss": _("Packet loss (0-1)"),
    "reorder": _("Reordering (0-1)"),
    "bitrate": _("Bit rate (bit/s)"),
    "dock": _("Charging station"),
    "checkpoints": _("Checkpoints"),
    "x": _("x (m)"),
    "y": _("y (m)"),
    "radius": _("Radius (m)"),
    "path": _("Suggested path"),
    "doors": _("Doors to pass through"),
    "zones": _("Zones"),
    "name": _("Short name"),
    "polygon": _("Corners"),
    "photo": _("Photo in a mirror"),
    "checkpoint": _("After checkpoint"),
    "mirror": _("Mirror"),
    "view": _("Angle (°)"),
    "InstructionPage.robot": _("Only for drivers of"),
    "InstructionPage.conditions": _("Only in these conditions"),
    "changes": _("What it changes"),
    "sets": _("This level sets"),
    "shared": _("In every condition"),
    "video_delay": _("Delay of the video (s)"),
    "video_jitter": _("Jitter of the video (s)"),
    "video_loss": _("Packet loss of the video (0-1)"),
    "control_delay": _("Delay of the commands (s)"),
    "control_jitter": _("Jitter of the commands (s)"),
    "control_loss": _("Packet loss of the commands (0-1)"),
    "factors": _("Factors"),
    "levels": _("Levels"),
    "measures": _("Measures"),
    "test": _("Test"),
    "contrasts": _("Contrasts"),
    "first": _("First side"),
    "second": _("Second side"),
    "conditions": _("Conditions"),
    "post_hoc": _("Compare all pairs"),
    "effects": _("Effects of the model"),
    "covariates": _("Covariates"),
    "coding": _("Coding of printed coefficients"),
    "allocation": _("Assignment to conditions"),
    "left_after_hours": _("Counts as dropped out after (hours)"),
    "design": _("Design"),
    "order": _("Order"),
    "quota": _("Participants per cell"),
    "best_probability": _("Probability of the smallest cell (0-1)"),
    "balancing": _("Balance factors by"),
    "balance": _("Balance factors"),
    "limits": _("Groups begin at"),
    "BalanceFactor.item": _("Age or answer"),
    "start": _("Before a drive starts"),
    "docked": _("Robot docked at its charging station"),
    "distance": _("Max. distance from station (m)"),
    "heading": _("Max. angle to station (°)"),
    "charge": _("Minimum charge (0-1)"),
    "refill": _("Participant replacement"),
    "outcomes": _("After these outcomes"),
    "most": _("Maximum per cell"),
    "quality": _("Data quality"),
    "least_sample_rate": _("Minimum sample rate (Hz)"),
    "longest_gap": _("Longest gap (s)"),
    "largest_clock_offset": _("Maximum clock offset (s)"),
    "condition_applied": _("Condition was applied"),
    "operator_absent": _("No operator intervened"),
    "analysis": _("Analysis"),
    "drives": _("Drives that count, of several in one condition"),
    "counts": _("Responses that count, of several by one participant"),
    "interval": _("Confidence intervals"),
    "statements": _("Questionnaire in the tables"),
    "operator": _("What it says about the hidden operator"),
    "recruitment": _("How participants are recruited"),
    "compensation": _("How participants are paid"),
    "turned_away_code": _("People who are turned away get a code"),
    "observers_allowed": _("Other people may watch the drives"),
    "question": _("Research question"),
    "hypotheses": _("Hypotheses"),
    "direction": _("What is expected"),
    "families": _("Families of hypotheses"),
    "alpha": _("Level of significance (0-1)"),
    "attention_checks": _("Attention checks"),
    "item": _("Item"),
    "answer": _("Right answer"),
    "speeders": _("Fast answers"),
    "seconds": _("Faster than (s)"),
    "median_share": _("Faster than this share of the median (0-1)"),
    "incomplete": _("Incomplete cases"),
    "faults": _("A drive is excluded if its record has one of these faults"),
    "participants": _("Planned participants"),
    "rationale": _("Reason for the number of participants"),
    "stopping": _("Stopping rule"),
    "power": _("Target power (0-1)"),
    "expected": _("Expected effects"),
    "measure": _("Measure"),
    "condition": _("Condition"),
    "difference": _("Difference from the first condition"),
    "level": _("Level in this condition"),
    "sd": _("Standard deviation"),
    "correlation": _("Correlation within participants (0-1)"),
    "blinding": _("Blinding"),
    "missing_data": _("Missing data"),
    "notes": _("Anything else"),
    "wizard": _("Hidden operator"),
    "stages": _("Stages of the script"),
    "steps": _("Steps"),
    "codes": _("Codes"),
    "Wizard.conditions": _("Conditions with a hidden operator"),
    "blind": _("Blind"),
    "participant_view": _("Show the instruction on the participant's page to the operator"),
    "by_hand": _("The operator may also drive by hand"),
    "Wizard.order": _("Order of the script"),
    "shortcut": _("Key on the operator's page"),
    "line": _("Line"),
    "aloud": _("Read aloud"),
    "within": _("Time limit after the previous step (s)"),
    "PlaceMove.name": _("Place"),
    "angle": _("Angle (°)"),
    "DriveMove.seconds": _("Duration (s)"),
    "StudyDefinition.coding": _("Coding of replays"),
    "bin": _("Bin (s)"),
    "tolerance": _("Tolerance (s)"),
    "code": _("Short name"),
    "Code.name": _("Name"),
    "Code.kind": _("Kind"),
    "Code.key": _("Key on the replay"),
    "description": _("Description"),
    "group": _("Group"),
    "modifiers": _("Modifiers"),
    "Modifier.name": _("Name"),
    "values": _("Values"),
    "recruiting": _("Recruitment site"),
    "Recruiting.site": _("Site"),
    "id_parameter": _("Parameter with the participant's id"),
    "return_address": _("Return address"),
    "returning": _("Who returns there"),
    "Recruiting.codes": _("Codes that the site gave you"),
    **{f"EndingCodes.{name}": words for name, words in ENDING_NAMES.items()},
    "devices": _("Allowed devices"),
    "browsers": _("Allowed browsers"),
    "screening": _("Required answers"),
    "answer_quotas": _("Quotas by answer"),
    "answers": _("Answers"),
    "at_least": _("At least"),
    "at_most": _("At most"),
    "AnswerQuota.most": _("Maximum number of participants"),
    "appointments": _("Appointments"),
    "required": _("Only participants with an appointment drive"),
    "Appointments.minutes": _("Length (minutes)"),
    "days_ahead": _("Bookable days ahead"),
    "reminder_hours": _("Reminder before it (hours)"),
    "second_after_days": _("Invite to a second session after (days)"),
}

HINTS: dict[str, Words] = {
    "languages": _(
        "Every text is required in each language. Removing a language deletes its texts."
    ),
    "key": _("Lower-case letters, digits and underscores. Used in the data."),
    "repeat": _("Repeated steps must be consecutive and include the task."),
    "minimum_age": _("Asked on the consent page."),
    "picture": _(
        "A built-in illustration (those of the map and the task show an example, not your course), "
        "or a file of your own: a picture of at most 2 MB, or a video of at most 8 MB."
    ),
    "doors_closed": _(
        "Doors of the site that are closed in this condition. All others are opened."
    ),
    "idle_seconds": _("Time without input. Leave blank to never ask; the time limit is enough."),
    "path": _("One point per line: x and y in metres."),
    "polygon": _("One corner per line: x and y in metres, in order. At least three."),
    "doors": _("Each applies only where the condition leaves the door open."),
    "view": _("Maximum angle between the mirror and the camera's axis."),
    "checkpoints": _(
        "Passed in this order. Every task begins and ends at checkpoint 0, the charging station."
    ),
    "actions": _(
        "With “undock automatically”, the robot leaves its station by itself when the drive "
        "begins. Without it, participants drive out themselves."
    ),
    "dock": _("Required if the site has several for this robot."),
    "quota": _("Leave blank for no limit. A cell is one condition or one order of conditions."),
    "best_probability": _(
        "With 1, staff who know the numbers know each assignment beforehand. 0.75 keeps cells even "
        "and assignments unpredictable."
    ),
    "balancing": _(
        "Strata count participants alike in all factors: for few factors with few levels. "
        "Minimization counts those alike in each factor and adds up."
    ),
    "balance": _("What should be distributed evenly over the cells. Leave empty for nothing."),
    "BalanceFactor.item": _(
        "age, or questionnaire.item such as ict.games, asked before the first drive."
    ),
    "limits": _(
        "Of numbers: where the second group begins, the third and so on, separated by commas."
    ),
    "sharing": _(
        "Text of a second tick, which participants can leave empty. Public datasets contain only "
        "those who set it. Leave blank not to ask."
    ),
    "left_after_hours": _(
        "If a participant with conditions left to do is not seen for this long, their order of "
        "conditions goes to someone else."
    ),
    "DeclaredAnalysis.measures": _(
        "Metrics of the drives, and scores and answers of the questionnaires that the study asks."
    ),
    "factors": _(
        "What you vary. The conditions are all combinations of the levels, and follow by "
        "themselves."
    ),
    "Factor.key": _("Used in the data. Leave blank to make it from the title."),
    "Level.key": _("Used in the data. Leave blank to make it from the title."),
    "Level.title": _("Leave blank to take the value."),
    "changes": _(
        "Save after ticking: each level then asks for its value. Tick nothing if the levels "
        "differ in instructions, or in what people do."
    ),
    "shared": _(
        "Settings that no factor changes. Where conditions differ, they are set on the page of "
        "each condition."
    ),
    "video_delay": _("0.3 is 300 ms. Delays what the driver sees, and no command."),
    "video_loss": _("Share of packets that get lost: 0.02 is 2 %."),
    "control_delay": _(
        "Above about 0.1 s including jitter, the robot slows down, and the study cannot be "
        "published: delay the video instead."
    ),
    "control_loss": _("Share of packets that get lost: 0.02 is 2 %."),
    "contrasts": _("All contrasts of all measures are one family for Holm's correction."),
    "conditions": _("The conditions to compare if there are no contrasts. Leave blank for all."),
    "Condition.robot": _(
        "Participants wait for it in the same queue as other visitors. To keep it for them during "
        "the study's hours, tick “Exclusive use of its robots” on the study's page."
    ),
    "InstructionPage.robot": _("If you tick none, everyone sees it."),
    "InstructionPage.conditions": _(
        "If you tick none, everyone sees it. If you tick some, participants are assigned to their "
        "condition when they reach these instructions, not when they first get the robot."
    ),
    "post_hoc": _("Applies only if there are no contrasts."),
    "recruitment": _("For the reporting sheet. Participants do not see it."),
    "compensation": _("For the reporting sheet. Participants do not see it."),
    "turned_away_code": _(
        "For recruitment sites that pay people who were screened out: they get a separate code. "
        "Otherwise, only people who reach the end get a code."
    ),
    "observers_allowed": _(
        "Everybody who may watch the robot then sees and hears a participant's drive. Say so in "
        "the consent. Otherwise only the participant, the people who operate the robot, and the "
        "study's owners and researchers see it."
    ),
    "direction": _(
        "Declare an analysis first; its effects and contrasts are then listed here. All other "
        "tests are exploratory."
    ),
    "Hypothesis.text": _("Leave blank to take the sentence that follows from your choices."),
    "Hypothesis.measures": _("If you tick none, all measures of the analysis."),
    "families": _(
        "All tests of a family are corrected together. The tests of a hypothesis in no family are"
        " corrected with its analysis."
    ),
    "attention_checks": _("Participants who give another answer are excluded."),
    "speeders": _("Participants who answer a questionnaire this fast are excluded."),
    "faults": _(
        "From all results but the sensitivity analysis. The limits are those of the study's "
        "requirements for records. Choose only faults that do not depend on how somebody drives: "
        "else conditions are compared by the drives that went well."
    ),
    "participants": _("Number of complete cases. Leave blank if not decided."),
    "expected": _("In the unit of the measure. The study's power is simulated from these values."),
    "level": _(
        "Only for proportions (a share), counts (events per minute) and times (the median in "
        "seconds), in place of a difference."
    ),
    "covariates": _("Of a model."),
    "effects": _("Of a model."),
    "docked": _("Otherwise the participant waits and the study's researchers get an e-mail."),
    "charge": _(
        "0.3 is 30 %; 0 accepts any charge. A robot that does not report its charge is always "
        "accepted."
    ),
    "docked_seconds": _(
        "Counted while the robot is still and the controls are released. At least 1."
    ),
    "controllers": _("Devices the visitor may drive with."),
    "linear": _(
        "Leave blank to use the robot's limit; cannot exceed it. 0.3 m/s is a slow walk, 1.3 m/s "
        "an ordinary one."
    ),
    "angular": _(
        "Leave blank to use the robot's limit; cannot exceed it. At 45 °/s, the robot turns around "
        "in four seconds."
    ),
    "heading": _("Between the robot's direction and that of a robot in the station."),
    "radius": _("How near the robot must come."),
    "control_way": _(
        "How commands reach the robot: directly from the browser (WebRTC), or through the server."
    ),
    "delay": _("How much later everything arrives."),
    "loss": _("Share of packets, the pieces in which data travels, that get lost: 0.02 is 2 %."),
    "least_sample_rate": _("How many states of the robot are recorded in a second."),
    "longest_gap": _("Without a recorded state of the robot."),
    "largest_clock_offset": _("Between the robot's clock and the server's."),
    "statements": _("The tables show this questionnaire's percentages."),
    "control": _(
        "Affects the driver's commands; stopping is never delayed. Above about 0.1 s including "
        "jitter, the robot slows down, and the study cannot be published: delay the video instead."
    ),
    "video": _("Affects video and sound to the driver only."),
    "jitter": _("Maximum deviation from the delay, up or down."),
    "reorder": _("Share of packets overtaken by the next one: 0.02 is 2 %."),
    "bitrate": _(
        "1000000 is 1 Mbit/s. Leave blank for no limit. Packets that would wait over half a second "
        "are dropped."
    ),
    "source": _("Origin of the study; shown with its data."),
    "operator": _("Required in a study with a hidden operator: a person drove the robot."),
    "wizard": _("A person drives the robot and speaks for it, and participants are not told."),
    "Wizard.conditions": _("Leave all blank for every condition."),
    "Wizard.blind": _("The operator is not told the condition."),
    "Wizard.order": _("Steps in another order are recorded as deviations."),
    "shortcut": _("A letter or digit. W, A, S and D drive the robot."),
    "line": _("The robot's screen shows it."),
    "within": _("Later is recorded as a deviation. Leave blank for no limit."),
    "TiltMove.angle": _("Positive looks down."),
    "TurnMove.angle": _("Positive is counter-clockwise."),
    "DriveMove.linear": _("Negative drives backwards. 0.3 m/s is a slow walk."),
    "DriveMove.angular": _("Positive is counter-clockwise."),
    "StudyDefinition.coding": _("What coders note on the replays. It is frozen with the study."),
    "CodingScheme.blind": _("Coders see neither the condition nor what would give it away."),
    "bin": _("Agreement by time is computed in bins of this length."),
    "tolerance": _("Events of two coders match if they begin at most this far apart."),
    "code": _("Lower-case letters, digits and underscores. Used in files."),
    "Code.key": _("One character. The player already uses k, + and −."),
    "group": _("State events of one group end each other."),
    "values": _("Separated by commas."),
    "recruiting": _(
        "Without a site, the ids of Prolific, Mechanical Turk, Sona and CloudResearch are "
        "recognized, and participants from Prolific and Mechanical Turk return by a button."
    ),
    "id_parameter": _("Leave blank for that of the site, such as PROLIFIC_PID."),
    "return_address": _(
        "Where participants go at the end. {code}, {id} and {session} are filled in. Leave blank "
        "for that of Prolific or Mechanical Turk; Sona, CloudResearch and other sites show you one."
    ),
    "returning": _(
        "If you tick none, everyone who gets a code; on Sona and CloudResearch, only those who are "
        "usually paid."
    ),
    "Recruiting.codes": _(
        "Leave blank for codes that this site makes. They stay the same in all versions."
    ),
    "devices": _("If you tick none, all are allowed. Checked before anything is recorded."),
    "browsers": _("If you tick none, all are allowed."),
    "screening": _(
        "Participants who answer otherwise are turned away as soon as they have finished the "
        "questionnaire."
    ),
    "answer_quotas": _("Participants beyond a quota are turned away. Those who leave make room."),
    "answers": _("As in the data, separated by commas: values, not labels."),
    "appointments": _(
        "Participants choose a time within the study's opening hours; one at a time on each robot. "
        "Reminders need an e-mail server and the command send_reminders."
    ),
    "second_after_days": _("Only participants who gave an address. Leave blank for none."),
}

CHOICES: dict[str, dict[str, Words]] = {
    "balancing": {"strata": _("strata"), "minimization": _("minimization")},
    "minors": {"refused": _("cannot take part"), "guardian": _("need a guardian's consent")},
    "access": {"open": _("anyone with the link"), "invitation": _("invited participants")},
    "control_way": {"any": _("any"), "datachannel": _("WebRTC only"), "mqtt": _("server only")},
    "controllers": {
        "keyboard": _("keyboard"),
        "mouse": _("mouse"),
        "touch": _("touch"),
        "stick": _("on-screen stick"),
        "gamepad": _("gamepad"),
    },
    "actions": {
        "places": _("go to places"),
        "map": _("go to a point on the map"),
        "follow": _("follow a route"),
        "dock": _("dock automatically"),
        "undock": _("undock automatically"),
        "tilt": _("tilt its head"),
    },
    "interface": {
        "standard": _("standard"),
        "novice": _("novice: most help, fewest details"),
        "expert": _("expert: no explanations"),
        "technical": _("technical: with connection figures"),
    },
    "assist": {
        "off": _("off"),
        "slow": _("slows down and stops at obstacles"),
        "steer": _("steers around obstacles and through doors"),
    },
    "changes": SETTINGS,
    "design": {
        "between": _("between participants: one condition each"),
        "within": _("within participants: all conditions"),
    },
    "order": {
        "fixed": _("as listed here"),
        "all": _("all orders"),
        "balanced": _("counterbalanced orders"),
    },
    "Wizard.order": {"stages": _("as it is written"), "free": _("as the operator sees fit")},
    "move": {
        "place": _("Go to a place"),
        "dock": _("Dock"),
        "undock": _("Leave the charging station"),
        "tilt": _("Tilt the head"),
        "turn": _("Turn on the spot"),
        "drive": _("Drive"),
    },
    "Code.kind": {"point": _("point event"), "interval": _("state event")},
    "test": {
        "means": _("means: t tests, analysis of variance"),
        "ranks": _("ranks: Wilcoxon, Mann-Whitney, Friedman, Kruskal-Wallis"),
        "proportions": _("proportions: completed or not"),
        "counts": _("counts per minute: Poisson regression"),
        "times": _("times to success: log-rank, Cox regression"),
        "mixed": _("linear mixed model"),
    },
    "incomplete": {
        "keep": _("kept"),
        "drives": _("excluded if a drive is missing, except from success and times"),
        "answers": _("excluded if a drive or an answer is missing, except from success and times"),
    },
    "faults": {
        "no_states": _("no state of the robot was recorded"),
        "rate": _("too few states a second"),
        "gap": _("too long a gap between states"),
        "clock_unknown": _("the clocks were never compared"),
        "clock": _("the clocks differed too much"),
        "condition": _("the condition was not applied as assigned"),
        "operator": _("an operator intervened"),
        "frozen_video": _("no new video frame in a fifth of the seconds, or more"),
    },
    "coding": {
        "treatment": _("against the first level"),
        "sum": _("against the mean of all levels"),
    },
    "drives": {"first": _("the first"), "last": _("the last"), "all": _("all")},
    "counts": {"first": _("the first"), "last": _("the last"), "all": _("all")},
    "interval": {"normal": _("normal distribution"), "t": _("Student's t")},
    "outcomes": SURVEY_CHOICES["outcome"],
    "Recruiting.site": {
        "any": _("any"),
        **{name: profile.title for name, profile in PROFILES.items()},
        "other": _("another one"),
    },
    "returning": ENDING_NAMES,
    "devices": {
        "computer": pgettext_lazy("a device", "computer"),
        "tablet": pgettext_lazy("a device", "tablet"),
        "phone": pgettext_lazy("a device", "phone"),
    },
}

ITEMS: dict[str, Words] = {
    "leaves": pgettext_lazy("of the instructions", "Page"),
    "checkpoints": _("Checkpoint"),
    "zones": _("Zone"),
    "factors": _("Factor"),
    "levels": _("Level"),
    "contrasts": _("Contrast"),
    "hypotheses": _("Hypothesis"),
    "families": _("Family"),
    "attention_checks": _("Attention check"),
    "speeders": _("Rule on fast answers"),
    "expected": _("Expected effect"),
    "balance": _("Balance factor"),
    "steps": _("Step"),
    "stages": _("Stage"),
    "codes": _("Code"),
    "modifiers": _("Modifier"),
    "screening": _("Required answer"),
    "answer_quotas": _("Quota"),
}
GUIDE = FormGuide(
    LABELS,
    HINTS,
    ITEMS,
    CHOICES,
    kinds={
        "WizardStage.steps": {"": _("Line")} | CHOICES["move"],
        "StudyDesign.factors": FACTORS | {"": _("Something else")},
    },
    hidden={
        StudyCheckpoint: frozenset({"number"}),  # its place in the list says it
        # Lists whose parts have pages of their own.
        Wizard: frozenset({"stages"}),
        CodingScheme: frozenset({"codes"}),
        AskingStep: frozenset({"version"}),  # chosen with the questionnaire
        Hypothesis: frozenset({"analysis", "contrast", "effect"}),  # chosen with the direction
        Condition: frozenset({"levels"}),  # they follow from the design
    },
    instead={WizardStep: {"move": frozenset({"line", "aloud"})}},
    details=frozenset({"Factor.key", "Level.key", "changes"}),
    long=frozenset(
        {
            *("text", "intro", "source", "recruitment", "compensation", "question", "rationale"),
            *("stopping", "blinding", "missing_data", "notes", "line", "description"),
        }
    ),
    spaced=frozenset({"values", "answers"}),
    angles=frozenset({"angular", "heading", "view", "angle"}),
)
