"""A study's pages about people: its researchers, its personal links, its opening hours."""

from typing import Any
from urllib.parse import quote

from django.contrib import messages
from django.core.exceptions import ValidationError
from django.db.models import QuerySet
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseRedirect
from django.shortcuts import get_object_or_404
from django.urls import reverse
from django.utils import timezone
from django.utils.translation import gettext as _, ngettext

from experiments import publishing
from experiments.access import may
from experiments.builder.forms import LinksForm, MemberForm
from experiments.builder.study_page import StudyPages, study_view
from experiments.models import PersonalLink, ResearcherInvitation, Study, StudyMember
from experiments.participation import links
from experiments.research.invitations import invite
from experiments.research.study_access import note_change
from experiments.study_admin import opening_hours
from robots.files.csv_text import csv_text

MOST_LISTED = 500


class PeoplePages(StudyPages):
    def _page(
        self, request: HttpRequest, row: Study, name: str, title: str, **context: Any
    ) -> HttpResponse:
        shown = {"sharing_tab": name, **context}
        return self.study_page(request, row, name, title, shown, tab="sharing")

    @study_view("researchers/", "members")
    def members_view(self, request: HttpRequest, row: Study) -> HttpResponse:
        is_owner = may(request.user, row.slug, "owner")
        form = MemberForm(request.POST if "add" in request.POST else None)
        invited: dict[str, Any] = {}
        invitations = ResearcherInvitation.objects.filter(slug=row.slug, accepted_at=None)
        if request.method == "POST" and not is_owner:
            raise Http404
        if "remove" in request.POST:
            _remove(request, row, request.POST["remove"])
            return HttpResponseRedirect(request.path)
        if "cancel" in request.POST:
            invitations.filter(email=request.POST["cancel"]).delete()
            return HttpResponseRedirect(request.path)
        if form.is_valid():
            person, role = form.cleaned_data["person"], form.cleaned_data["role"]
            if person is not None:
                _add(request, row, person, role)
                return HttpResponseRedirect(request.path)
            link, is_sent = invite(request, row, form.invited, role)
            publishing.log(row, request.user, f"Invited: {role}.")
            invited = {"email": form.invited, "link": link, "is_sent": is_sent}
            form = MemberForm()
        context = {"form": form, "is_owner": is_owner, "now": timezone.now(), "invited": invited}
        context |= {"members": _members(row).order_by("user__username"), "invitations": invitations}
        return self._page(request, row, "members", _("Researchers"), **context)

    @study_view("links/", "links", "researcher")
    def links_view(self, request: HttpRequest, row: Study) -> HttpResponse:
        """Show links without tokens; a POST makes some, shown once, or revokes one."""
        definition = row.as_definition()
        form = LinksForm(definition, request.POST if "make" in request.POST else None)
        made = None
        if request.method == "POST":
            if row.status == Study.Status.CLOSED:
                raise Http404
            if "revoke" in request.POST:
                _revoke(request, row, request.POST["revoke"])
                return HttpResponseRedirect(request.path)
            if form.is_valid():
                made, form = _made_links(request, row, form), LinksForm(definition)
        rows = PersonalLink.objects.filter(study=row).select_related("participant__user")
        context = {"links": rows[:MOST_LISTED], "form": form, "made": made, "now": timezone.now()}
        return self._page(request, row, "links", _("Personal links"), **context)

    @study_view("hours/", "hours")
    def hours_view(self, request: HttpRequest, row: Study) -> HttpResponse:
        is_owner = may(request.user, row.slug, "owner")
        lines = {"time_zone": row.time_zone, **opening_hours.lines_by_day(row.opening_hours)}
        form = opening_hours.HoursForm(request.POST or None, initial=lines)
        if request.method == "POST" and not is_owner:
            raise Http404
        if form.is_valid():
            row.opening_hours, row.time_zone = form.hours, form.cleaned_data["time_zone"]
            row.save(update_fields=["opening_hours", "time_zone"])
            text = opening_hours.summary(row.opening_hours, row.time_zone)
            entry, words = f"Opening hours: {text}.", _("Opening hours: %(hours)s.")
            note_change(request, row, entry, words % {"hours": text}, detail="opening hours")
            return HttpResponseRedirect(request.path)
        summary = opening_hours.summary(row.opening_hours, row.time_zone)
        context = {"form": form, "is_owner": is_owner, "summary": summary}
        return self._page(request, row, "hours", _("Opening hours"), **context)


def _members(row: Study) -> "QuerySet[StudyMember]":
    return StudyMember.objects.filter(slug=row.slug).select_related("user")


def _add(request: HttpRequest, row: Study, user: Any, role: str) -> None:
    member = _members(row).filter(user=user).first()
    if role != StudyMember.Role.OWNER and _is_last_owner(member):
        messages.error(request, _("A study needs at least one owner."))
        return
    StudyMember.objects.update_or_create(slug=row.slug, user=user, defaults={"role": role})
    text = _("%(person)s is now a researcher of this study.") % {"person": user.shown_name}
    entry = f"Researcher {user.username}: {role}."
    note_change(request, row, entry, text, event="member_added", person=user, detail=role)


def _remove(request: HttpRequest, row: Study, pk: str) -> None:
    member = _row_of(_members(row), pk)
    if _is_last_owner(member):
        messages.error(request, _("A study needs at least one owner."))
        return
    member.delete()
    user = member.user
    text = _("%(person)s is no longer a researcher of this study.") % {"person": user.shown_name}
    entry = f"Researcher {user.username} removed."
    note_change(request, row, entry, text, event="member_removed", person=user)


def _is_last_owner(member: StudyMember | None) -> bool:
    if member is None or member.role != StudyMember.Role.OWNER:
        return False
    owners = StudyMember.objects.filter(slug=member.slug, role=StudyMember.Role.OWNER)
    return not owners.exclude(pk=member.pk).exists()


def _row_of(rows: "QuerySet[Any]", key: str) -> Any:
    """Return the row with a primary key that a form sent, which may be any text, or Http404."""
    try:
        return get_object_or_404(rows, pk=key)
    except (ValueError, ValidationError) as error:
        raise Http404 from error


def _made_links(request: HttpRequest, row: Study, form: LinksForm) -> dict[str, Any]:
    now, given = timezone.now(), form.cleaned_data
    until, count = form.expires_at(now), given["count"]
    expires = until.isoformat(timespec="seconds") if until else ""
    rows = [("label", "link", "expires")]
    options = {"access": given["access"], "expires_at": until, "now": now}
    for n in range(1, count + 1):
        label = f"{given['label']} {n}".strip()
        _link, token = links.make(row, label=label, **options)
        address = request.build_absolute_uri(reverse("study_link", args=[token]))
        rows.append((label, address, expires))
    file = csv_text(rows)
    entry = f"{count} personal links made."
    note_change(request, row, entry, event="links_made", detail=str(count))
    name, href = f"{row.slug}-{row.version}-links.csv", f"data:text/csv;charset=utf-8,{quote(file)}"
    return {"count": count, "file": name, "text": file, "href": href}


def _revoke(request: HttpRequest, row: Study, pk: str) -> None:
    link = _row_of(PersonalLink.objects.filter(study=row), pk)
    if links.revoke(link, timezone.now()):
        text = _("Link revoked. It no longer works.")
        entry = f"Personal link revoked: {link}."
        note_change(request, row, entry, text, event="link_revoked", thing=link)
    else:
        messages.error(request, _("This link has already been used or revoked."))


def made(count: int) -> str:
    return ngettext("%(n)d study was added.", "%(n)d studies were added.", count) % {"n": count}
