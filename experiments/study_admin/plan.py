"""A study's plan in the administration: preregistration, deviations, power by simulation."""

import json
import subprocess
from typing import Any

from django import forms
from django.core.validators import MaxLengthValidator
from django.http import HttpRequest, HttpResponse
from django.shortcuts import redirect
from django.utils.translation import gettext as _, gettext_lazy, ngettext
from django.views.decorators.http import require_POST, require_safe

from experiments.access import may
from experiments.analysis.plan.preregistration import preregistration
from experiments.builder.study_page import StudyPages, study_view
from experiments.dataset.records import FreezeRecord
from experiments.extraction.answers import questionnaires_of
from experiments.extraction.build import freeze_of
from experiments.models import Study
from experiments.research.analysis_cache import command, environment
from experiments.research.study_access import note_change

STUDIES = 500  # simulated for each number: a page does not wait long
SECONDS = 120.0
SIZES = "16, 24, 32, 48, 64"
MOST_SIZES, MOST_PARTICIPANTS, MOST_TEXT = 8, 1000, 20_000


class PowerForm(forms.Form):
    participants = forms.CharField(
        label=gettext_lazy("Numbers of participants"), initial=SIZES, max_length=80
    )

    def clean_participants(self) -> str:
        words = self.cleaned_data["participants"].replace(",", " ").split()
        numbers = [int(word) for word in words if word.isascii() and word.isdigit()]
        are_sizes = all(1 <= n <= MOST_PARTICIPANTS for n in numbers)
        if not 1 <= len(words) == len(numbers) <= MOST_SIZES or not are_sizes:
            text = _("Write up to %(most)d numbers from 1 to %(greatest)d, separated by commas.")
            limits = {"most": MOST_SIZES, "greatest": MOST_PARTICIPANTS}
            raise forms.ValidationError(text % limits)
        return ",".join(words)


class DeviationsForm(forms.Form):
    deviations = forms.CharField(
        label=gettext_lazy("Deviations from the plan"),
        required=False,
        widget=forms.Textarea({"rows": 6, "cols": 90}),
        validators=[MaxLengthValidator(MOST_TEXT)],
        help_text=gettext_lazy(
            "What was done differently, when and why. It is exported with the data."
        ),
    )


class PlanPages(StudyPages):
    @study_view("plan/", "plan", guard=require_safe)
    def plan_view(self, request: HttpRequest, row: Study) -> HttpResponse:
        return self._plan(request, row, PowerForm())

    @study_view("plan/preregistration.md", "preregistration", guard=require_safe)
    def preregistration_view(self, _request: HttpRequest, row: Study) -> HttpResponse:
        name = f"{row.slug}-{row.version}-preregistration.md"
        text = preregistration(row.as_definition(), freeze_of(row), questionnaires_of(row))
        headers = {"Content-Disposition": f'attachment; filename="{name}"'}
        return HttpResponse(text, content_type="text/markdown; charset=utf-8", headers=headers)

    @study_view("plan/power/", "power", "researcher", require_POST)
    def power_view(self, request: HttpRequest, row: Study) -> HttpResponse:
        form = PowerForm(request.POST)
        if not form.is_valid():
            return self._plan(request, row, form, status=422)
        table, failure = _simulated(row, form.cleaned_data["participants"])
        power = table and by_test(table)
        status = 200 if table else 503
        return self._plan(request, row, form, status=status, power=power, failure=failure)

    @study_view("plan/deviations/", "deviations", "owner", require_POST)
    def deviations_view(self, request: HttpRequest, row: Study) -> HttpResponse:
        form = DeviationsForm(request.POST)
        if not form.is_valid():
            return self._plan(request, row, PowerForm(), deviations=form, status=422)
        Study.objects.filter(pk=row.pk).update(deviations=form.cleaned_data["deviations"])
        entry = "Changed: deviations from the plan."
        note_change(request, row, entry, _("Saved."), detail="deviations")
        return redirect("admin:experiments_study_plan", row.pk)

    def _plan(
        self, request: HttpRequest, row: Study, form: PowerForm, status: int = 200, **more: Any
    ) -> HttpResponse:
        definition, freeze = row.as_definition(), freeze_of(row)
        context = {
            "plan": definition.plan,
            "analyses": definition.analyses,
            "text": preregistration(definition, freeze, questionnaires_of(row)),
            "freeze": freeze,
            "data_then": data_when_frozen(freeze),
            "form": form,
            "may_research": may(request.user, row.slug, "researcher"),
            "is_owner": may(request.user, row.slug, "owner"),
            "deviations": DeviationsForm({"deviations": row.deviations}),
        }
        title, shown = _("Preregistration and power"), context | more
        return self.study_page(request, row, "plan", title, shown, tab="overview", status=status)


def by_test(found: dict[str, Any]) -> dict[str, Any]:
    """Return a simulation's table with a row for each test: power and interval by sample size."""
    sizes = sorted({size for size, *_rest in found["rows"]}, key=int)
    powers: dict[tuple[str, ...], dict[str, tuple[str, str]]] = {}
    for size, analysis, measure, test, hypothesis, power, low, high in found["rows"]:
        key = (analysis, measure, test, hypothesis)
        powers.setdefault(key, {})[size] = power, f"{low}–{high}"
    heads = found["head"][1:5]
    if not any(hypothesis for *_names, hypothesis in powers):
        heads, powers = heads[:-1], {key[:-1]: cells for key, cells in powers.items()}
    return {
        "summary": found["notes"][0],
        "notes": found["notes"][1:],
        "heads": heads,
        "over": "Power and its 95 % interval, by number of participants",  # English, as all of it
        "sizes": sizes,
        "tests": [(names, [cells[size] for size in sizes]) for names, cells in powers.items()],
    }


def data_when_frozen(freeze: FreezeRecord) -> str:
    """Return in the page's language who had joined a study when it was frozen."""
    if freeze.before_data is None:
        return ""
    text = _("A participant of this version had already joined.")
    if freeze.before_data:
        text = _("No participant of this version had joined before that.")
    if not freeze.earlier:
        return text
    earlier = ngettext(
        "%(n)d participant had joined an earlier version, whose data were known.",
        "%(n)d participants had joined earlier versions, whose data were known.",
        freeze.earlier,
    )
    return f"{text} {earlier % {'n': freeze.earlier}}"


def _simulated(row: Study, sizes: str) -> tuple[dict[str, Any] | None, str]:
    """Return the table of a simulation, made by a process of its own, or why there is none."""
    options = ("--participants", sizes, "--studies", str(STUDIES), "--json")
    call, env = command("power", f"{row.slug}:{row.version}", *options), environment()
    try:
        done = subprocess.run(
            call, env=env, check=True, capture_output=True, timeout=SECONDS, text=True
        )
    except subprocess.TimeoutExpired:
        return None, _("The simulation took too long. Try fewer or smaller numbers.")
    except subprocess.CalledProcessError as error:
        return None, (error.stderr or "").strip().rpartition("\n")[2]
    return json.loads(done.stdout), ""
