"""Pages of the administration that import a questionnaire from a file of another system: the report
first, then the questionnaire. Between them it is in the form, signed, so that the server stores
nothing that is not saved.
"""

from typing import Any

import msgspec
from django import forms
from django.contrib import admin, messages
from django.contrib.auth.decorators import permission_required
from django.core import signing
from django.http import HttpRequest, HttpResponse
from django.shortcuts import redirect, render
from django.utils import timezone
from django.utils.translation import gettext as _, gettext_lazy
from django.views.decorators.http import require_http_methods, require_POST

from accounts import audit
from surveys.definition import Definition, from_stored
from surveys.document_forms.fields import language_name
from surveys.document_forms.problem_text import sentences
from surveys.documents import BadDefinitionError
from surveys.forms import NameField, format_reference
from surveys.importing.reading import MAX_FILE, import_survey
from surveys.importing.report import ImportReport
from surveys.models import Questionnaire
from surveys.questionnaires import store_next

ADD = "surveys.add_questionnaire"
# Forms that were signed under this name stay valid.
SALT = "surveys.admin_import"
PARCEL_SECONDS = 24 * 3600


class FileForm(forms.Form):
    file = forms.FileField(label=gettext_lazy("File"), help_text=format_reference("questionnaires"))
    language = forms.RegexField(
        r"^[a-z]{2,3}(-[a-z0-9]{2,8})*$",
        label=gettext_lazy("Language"),
        initial="en",
        max_length=16,
        help_text=gettext_lazy(
            "Only for REDCap, whose files do not name the language of their texts."
        ),
    )
    form = forms.CharField(
        label=gettext_lazy("Form"),
        required=False,
        max_length=100,
        help_text=gettext_lazy("Only for REDCap: the form to import. Leave blank to import all."),
    )


class SaveForm(forms.Form):
    name = NameField(
        help_text=gettext_lazy(
            "Lower-case letters, digits and “-”. If the name exists, this becomes its next version."
        )
    )
    parcel = forms.CharField(widget=forms.HiddenInput)


@require_http_methods(["GET", "HEAD", "POST"])
@permission_required(ADD, raise_exception=True)
def choose(request: HttpRequest) -> HttpResponse:
    form = FileForm(request.POST, request.FILES) if request.method == "POST" else FileForm()
    if not form.is_valid():
        return _page(request, {"form": form})
    document = form.cleaned_data["file"].read(MAX_FILE + 1)
    language, one_form = form.cleaned_data["language"], form.cleaned_data["form"].strip()
    try:
        found = import_survey(document, language, one_form)
    except BadDefinitionError as error:
        form.add_error("file", sentences(error.problems))
        return _page(request, {"form": form})
    if found.definition is None:
        form.add_error("file", found.problems)
        return _page(request, {"form": form})
    documents = msgspec.to_builtins([found.definition, found.report])
    parcel = signing.dumps(documents, salt=SALT, compress=True)
    save_form = SaveForm(initial={"name": found.slug, "parcel": parcel})
    return _page(request, _shown(save_form, found.definition, found.report))


@require_POST
@permission_required(ADD, raise_exception=True)
def save(request: HttpRequest) -> HttpResponse:
    form = SaveForm(request.POST)
    try:
        parcel = request.POST.get("parcel", "")
        document, found = signing.loads(parcel, salt=SALT, max_age=PARCEL_SECONDS)
    except signing.BadSignature:
        messages.error(request, _("The import has expired. Choose the file again."))
        return redirect("admin:surveys_questionnaire_import")
    definition, report = from_stored(document), msgspec.convert(found, ImportReport)
    if not form.is_valid():
        return _page(request, _shown(form, definition, report))
    named = msgspec.structs.replace(definition, slug=form.cleaned_data["name"])
    try:
        row, is_new = store_next(named, report, timezone.now())
    except BadDefinitionError as error:
        form.add_error(None, sentences(error.problems))
        return _page(request, _shown(form, definition, report))
    words = {"version": row.version, "name": row.slug}
    if is_new:
        audit.note("questionnaire_imported", actor=request.user, thing=row, detail=row.slug)
        text = _("Imported as version %(version)d of “%(name)s”. Preview it before you use it.")
        messages.success(request, text % words)
    else:
        text = _("No copy was stored: version %(version)d of “%(name)s” is identical.")
        messages.info(request, text % words)
    return redirect("admin:surveys_questionnaire_change", row.pk)


def _shown(form: SaveForm, definition: Definition, report: ImportReport) -> dict[str, Any]:
    return {
        "save_form": form,
        "report": report,
        "pages": len(definition.pages),
        "questions": len(definition.questions()),
        "languages": ", ".join(map(language_name, definition.languages)),
    }


def _page(request: HttpRequest, context: dict[str, Any]) -> HttpResponse:
    about = {"title": _("Import a questionnaire"), "limit": MAX_FILE // 1024**2}
    about = {**admin.site.each_context(request), **about, "opts": Questionnaire._meta}
    return render(request, "admin/surveys/questionnaire/import.html", {**about, **context})


PAGES = (("import/", choose, "import"), ("import/save/", save, "import_save"))
