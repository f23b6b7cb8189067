"""The dataset of a study as a download, and the page that offers it: made by a process of its own,
and sent while it is made.
"""

import asyncio
from collections.abc import AsyncIterator, Iterable
from typing import Any

import structlog
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase, StreamingHttpResponse
from django.shortcuts import render
from django.urls import reverse
from django.utils.translation import gettext_lazy
from django.views.decorators.cache import never_cache
from django.views.decorators.debug import sensitive_post_parameters
from django.views.decorators.http import require_POST

from accounts import audit
from experiments.access import Role, for_role, may
from experiments.definition.publication import from_stored
from experiments.deposit.upload import REPOSITORIES
from experiments.export.anonymity import sharing_warnings
from experiments.export.formats import ON_REQUEST
from experiments.research.analysis_cache import command, environment
from experiments.research.analysis_query import asked_of, versions_of
from experiments.research.study_access import viewer_page
from sessions.system_log import log as keep
from surveys.document_forms.guide import column_of, word_table

logger = structlog.stdlib.get_logger(__name__)
PART = 64 * 1024
# The least role for each option of the export.
LEAST: dict[str, Role] = {
    **{name: one.least for name, one in ON_REQUEST.items()},
    "public": "viewer",
    "free_text": "researcher",
    "identified": "owner",
}
# The fields of the publication details, as pages show them.
PUBLICATION = word_table(__file__, "publication.csv")
PUBLICATION_LABELS = column_of(PUBLICATION, "label", gettext_lazy)


def labels_of(names: Iterable[str]) -> list[str]:
    return [str(PUBLICATION_LABELS[name]) for name in names]


@viewer_page
def page(request: HttpRequest, slug: str) -> HttpResponse:
    asked = asked_of(request, slug)
    study, user = asked.study, request.user
    details = reverse("admin:experiments_study_publication", args=[study.pk])
    titles = {name: one.title for name, one in REPOSITORIES.items()}
    formats = [(name, one) for name, one in ON_REQUEST.items() if may(user, slug, one.least)]
    context = {
        "asked": asked,
        "study": study,
        "versions": versions_of(study),
        "dataset": reverse("analysis_dataset", args=[slug]),
        "formats": [(name, one.label) for name, one in formats],
        "repositories": titles if may(user, slug, "owner") else {},
        "deposit": reverse("analysis_deposit", args=[slug]),
        "drafts": sorted(study.deposits.items()),
        "warnings": sharing_warnings(study),
        "missing": labels_of(from_stored(study.publication).missing),
        "details": details if user.is_staff else "",
        "may_see_text": may(user, slug, LEAST["free_text"]),
        "may_identify": may(user, slug, LEAST["identified"]),
    }
    return render(request, "experiments/analysis/export.html", context)


@viewer_page
def dataset(request: HttpRequest, slug: str) -> HttpResponseBase:
    """Send the dataset of a version of a study as a ZIP archive, and record who exported what; a
    user without the role for an option finds nothing.
    """
    chosen = [name for name in LEAST if request.GET.get(name)]
    if not all(may(request.user, slug, LEAST[name]) for name in chosen):
        raise Http404
    if "public" in chosen:  # of what else was chosen, a public dataset has nothing
        chosen = ["public"]
    user: Any = request.user
    number = asked_of(request, slug).study.version
    keep("study_exported", study=slug, version=number, chosen=chosen, user=str(user.pk))
    thing, detail = f"version {number}", " ".join(chosen)
    audit.note("study_exported", actor=user, study=slug, thing=thing, detail=detail)
    options = [f"--{name.replace('_', '-')}" for name in chosen]
    words = ("export_study", f"{slug}:{number}", "--zip", "--out", "-", "--noted", *options)
    name = "-".join((slug, str(number), *chosen))
    headers = {"Content-Disposition": f'attachment; filename="{name}.zip"'}
    parts = _output(command(*words), environment())
    return StreamingHttpResponse(parts, content_type="application/zip", headers=headers)


@sensitive_post_parameters("token")
@never_cache
@require_POST
@for_role("owner")
def deposit(request: HttpRequest, slug: str) -> HttpResponseBase:
    """Upload the public dataset to a repository as a draft, and show its progress. The token goes
    to the command alone, in its environment.
    """
    number = asked_of(request, slug).study.version
    repository = REPOSITORIES.get(request.POST.get("to", ""))
    if repository is None:
        raise Http404
    sandbox = ["--sandbox"] if request.POST.get("sandbox") else []
    by: Any = request.user.pk
    options = ("--to", request.POST["to"], "--by", str(by), *sandbox)
    words = command("deposit", f"{slug}:{number}", *options)
    variables = {repository.token: request.POST.get("token", ""), "PYTHONUNBUFFERED": "1"}
    parts = _output(words, environment() | variables, with_errors=True)
    return StreamingHttpResponse(parts, content_type="text/plain; charset=utf-8")


async def _output(
    words: list[str], variables: dict[str, str], *, with_errors: bool = False
) -> AsyncIterator[bytes]:
    """Yield what a command prints, and stop it when the client disconnects. A command that fails
    aborts the download, so that it is not taken for complete, unless its errors are shown.
    """
    process = await asyncio.create_subprocess_exec(
        *words,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT if with_errors else None,
        env=variables,
    )
    assert process.stdout is not None
    try:
        while part := await process.stdout.read(PART):
            yield part
        if await process.wait() and not with_errors:
            logger.error("export_failed", code=process.returncode)
            raise ConnectionAbortedError("the export failed")
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
