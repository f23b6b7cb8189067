"""The dataset of a study as a download, and the page that offers it: made by a process of its own,
and sent while it is made.
"""

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import structlog
from django.http import (
    Http404,
    HttpRequest,
    HttpResponse,
    HttpResponseBase,
    StreamingHttpResponse,
)
from django.shortcuts import render
from django.urls import reverse
from django.views.decorators.cache import never_cache
from django.views.decorators.debug import sensitive_post_parameters
from django.views.decorators.http import require_POST, require_safe

from accounts import audit
from experiments.access import Role, for_role, may
from experiments.definition.publication import from_stored
from experiments.deposit.upload import REPOSITORIES
from experiments.export.formats import ON_REQUEST
from experiments.research.analysis_cache import command, environment
from experiments.research.analysis_query import asked_of, versions_of
from experiments.research.publication_labels import details_page, labels_of
from sessions.system_log import log as keep

logger = structlog.stdlib.get_logger(__name__)
PART = 64 * 1024
# What may be chosen, and who may.
LEAST: dict[str, Role] = {
    **{name: one.least for name, one in ON_REQUEST.items()},
    "public": "viewer",
    "free_text": "researcher",
    "identified": "owner",
}


@never_cache
@require_safe
@for_role("viewer")
def page(request: HttpRequest, slug: str) -> HttpResponse:
    """Offer the dataset of a version, with what whoever asks may have in it."""
    asked = asked_of(request, slug)
    context = {
        "asked": asked,
        "study": asked.study,
        "versions": versions_of(asked.study),
        "dataset": reverse("analysis_dataset", args=[slug]),
        "formats": [
            (name, one.label)
            for name, one in ON_REQUEST.items()
            if may(request.user, slug, one.least)
        ],
        "repositories": {name: one.title for name, one in REPOSITORIES.items()}
        if may(request.user, slug, "owner")
        else {},
        "deposit": reverse("analysis_deposit", args=[slug]),
        "drafts": sorted(asked.study.deposits.items()),
        "missing": labels_of(from_stored(asked.study.publication).missing),
        "details": details_page(request.user, asked.study),
        "may_see_text": may(request.user, slug, LEAST["free_text"]),
        "may_identify": may(request.user, slug, LEAST["identified"]),
    }
    return render(request, "experiments/analysis/export.html", context)


@require_safe
@for_role("viewer")
def dataset(request: HttpRequest, slug: str) -> HttpResponseBase:
    """Send the dataset of a version of a study as a ZIP archive, and write down who took what;
    whoever may not have it finds nothing.
    """
    chosen = [name for name in LEAST if request.GET.get(name)]
    if not all(may(request.user, slug, LEAST[name]) for name in chosen):
        raise Http404
    if "public" in chosen:  # of what else was chosen, a public dataset has nothing
        chosen = ["public"]
    asked = asked_of(request, slug)
    user: Any = request.user
    keep(
        "study_exported", study=slug, version=asked.study.version, chosen=chosen, user=str(user.pk)
    )
    audit.note(
        "study_exported",
        actor=user,
        study=slug,
        thing=f"version {asked.study.version}",
        detail=" ".join(chosen),
    )
    words = (
        "export_study",
        f"{slug}:{asked.study.version}",
        "--zip",
        "--out",
        "-",
        "--noted",
        *(f"--{name.replace('_', '-')}" for name in chosen),
    )
    name = "-".join((slug, str(asked.study.version), *chosen))
    headers = {
        "Content-Disposition": f'attachment; filename="{name}.zip"',
        "Cache-Control": "private, no-store",
    }
    return StreamingHttpResponse(
        _output(command(*words), environment()), content_type="application/zip", headers=headers
    )


@sensitive_post_parameters("token")
@never_cache
@require_POST
@for_role("owner")
def deposit(request: HttpRequest, slug: str) -> HttpResponseBase:
    """Upload the public dataset to a repository as a draft, and show how far that is. The
    token goes to the command alone, in its environment.
    """
    asked = asked_of(request, slug)
    repository = REPOSITORIES.get(request.POST.get("to", ""))
    if repository is None:
        raise Http404
    sandbox = ["--sandbox"] if request.POST.get("sandbox") else []
    words = command(
        "deposit", f"{slug}:{asked.study.version}", "--to", request.POST["to"], *sandbox
    )
    told = {repository.token: request.POST.get("token", ""), "PYTHONUNBUFFERED": "1"}
    headers = {"Cache-Control": "private, no-store"}
    return StreamingHttpResponse(
        _output(words, environment() | told, with_errors=True),
        content_type="text/plain; charset=utf-8",
        headers=headers,
    )


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
