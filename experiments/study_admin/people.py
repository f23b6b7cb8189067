"""Pages of a study about people: its researchers, its personal links, its opening hours. Mixed into
the studies' administration.
"""

from typing import Any
from urllib.parse import quote

from django.contrib import messages
from django.db import IntegrityError
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseRedirect
from django.shortcuts import get_object_or_404
from django.urls import URLPattern, reverse
from django.utils import timezone
from django.utils.translation import gettext as _
from django.utils.translation import ngettext

from accounts import audit
from experiments import publishing
from experiments.access import may
from experiments.builder.forms import LinksForm, MemberForm
from experiments.builder.study_page import StudyPages
from experiments.models import PersonalLink, ResearcherInvitation, Study, StudyMember
from experiments.participation import links
from experiments.research.invitations import invite
from experiments.research.study_access import study_for
from experiments.study_admin import opening_hours
from robots.files.csv_text import csv_text

MOST_LISTED = 500


class PeoplePages(StudyPages):
    """Researchers, links and hours."""

    def people_urls(self) -> list[URLPattern]:
        return [
            self.study_path("researchers/", self.members_view, "members"),
            self.study_path("links/", self.links_view, "links"),
            self.study_path("hours/", self.hours_view, "hours"),
        ]

    def _page(
        self, request: HttpRequest, row: Study, name: str, title: str, **context: Any
    ) -> HttpResponse:
        shown = {"sharing_tab": name, **context}
        return self.study_page(request, row, name, title, shown, tab="sharing")

    # --- researchers ------------------------------------------------------------------------------

    def members_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Show who belongs to a study; owners add, invite, change and remove."""
        row = study_for(request, pk, "viewer")
        is_owner = may(request.user, row.slug, "owner")
        form = MemberForm(request.POST if "add" in request.POST else None)
        invited: dict[str, Any] = {}
        if request.method == "POST" and not is_owner:
            raise Http404
        if "remove" in request.POST:
            self._remove(request, row, request.POST["remove"])
            return HttpResponseRedirect(request.path)
        if "cancel" in request.POST:
            waiting = ResearcherInvitation.objects.filter(slug=row.slug, accepted_at=None)
            waiting.filter(email=request.POST["cancel"]).delete()
            return HttpResponseRedirect(request.path)
        if form.is_valid():
            person, role = form.cleaned_data["person"], form.cleaned_data["role"]
            if person is not None:
                self._add(request, row, person, role)
                return HttpResponseRedirect(request.path)
            link, is_sent = invite(request, row, form.invited, role)
            publishing.log(row, request.user, f"Invited: {role}.")
            invited = {"email": form.invited, "link": link, "is_sent": is_sent}
            form = MemberForm()
        members = StudyMember.objects.filter(slug=row.slug).select_related("user")
        context = {
            "members": members.order_by("user__username"),
            "invitations": ResearcherInvitation.objects.filter(slug=row.slug, accepted_at=None),
            "invited": invited,
            "now": timezone.now(),
            "form": form,
            "is_owner": is_owner,
        }
        return self._page(request, row, "members", _("Researchers"), **context)

    def _add(self, request: HttpRequest, row: Study, user: Any, role: str) -> None:
        member = StudyMember.objects.filter(slug=row.slug, user=user).first()
        if member is not None and role != StudyMember.Role.OWNER and self._is_last_owner(member):
            messages.error(request, _("A study needs at least one owner."))
            return
        try:
            StudyMember.objects.update_or_create(slug=row.slug, user=user, defaults={"role": role})
        except IntegrityError:  # a second tab was quicker, with the same person
            StudyMember.objects.filter(slug=row.slug, user=user).update(role=role)
        publishing.log(row, request.user, f"Researcher {user.username}: {role}.")
        audit.note("member_added", actor=request.user, person=user, study=row.slug, detail=role)
        messages.success(
            request,
            _("%(person)s is now a researcher of this study.") % {"person": user.shown_name},
        )

    def _remove(self, request: HttpRequest, row: Study, pk: str) -> None:
        members = StudyMember.objects.filter(slug=row.slug).select_related("user")
        member = next((one for one in members if str(one.pk) == pk), None)
        if member is None:
            raise Http404
        if self._is_last_owner(member):
            messages.error(request, _("A study needs at least one owner."))
            return
        member.delete()
        publishing.log(row, request.user, f"Researcher {member.user.username} removed.")
        audit.note("member_removed", actor=request.user, person=member.user, study=row.slug)
        messages.success(
            request,
            _("%(person)s is no longer a researcher of this study.")
            % {"person": member.user.shown_name},
        )

    @staticmethod
    def _is_last_owner(member: StudyMember) -> bool:
        owners = StudyMember.objects.filter(slug=member.slug, role=StudyMember.Role.OWNER)
        return member.role == StudyMember.Role.OWNER and not owners.exclude(pk=member.pk).exists()

    # --- personal links ---------------------------------------------------------------------------

    def links_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Show the links of a study without their tokens; a POST makes some, which this one answer
        shows and offers as a file, or revokes one.
        """
        row = study_for(request, pk, "researcher")
        definition = row.as_definition()
        form = LinksForm(definition, request.POST if "make" in request.POST else None)
        made = None
        if request.method == "POST":
            if row.status == Study.Status.CLOSED:
                raise Http404
            if "revoke" in request.POST:
                return self._revoke(request, row, request.POST["revoke"])
            if form.is_valid():
                made, form = self._made(request, row, form), LinksForm(definition)
        rows = PersonalLink.objects.filter(study=row).select_related("participant__user")
        context = {"links": rows[:MOST_LISTED], "form": form, "made": made, "now": timezone.now()}
        return self._page(request, row, "links", _("Personal links"), **context)

    def _made(self, request: HttpRequest, row: Study, form: LinksForm) -> dict[str, Any]:
        now, told = timezone.now(), form.cleaned_data
        until, count = form.expires_at(now), told["count"]
        expires = until.isoformat(timespec="seconds") if until else ""
        rows = [("label", "link", "expires")]
        for n in range(1, count + 1):
            label = f"{told['label']} {n}".strip()
            _link, token = links.make(
                row, label=label, access=told["access"], expires_at=until, now=now
            )
            address = request.build_absolute_uri(reverse("study_link", args=[token]))
            rows.append((label, address, expires))
        file = csv_text(rows)
        publishing.log(row, request.user, f"{count} personal links made.")
        audit.note("links_made", actor=request.user, study=row.slug, detail=str(count))
        return {
            "count": count,
            "file": f"{row.slug}-{row.version}-links.csv",
            "text": file,
            "href": f"data:text/csv;charset=utf-8,{quote(file)}",
        }

    @staticmethod
    def _revoke(request: HttpRequest, row: Study, pk: str) -> HttpResponse:
        known = {
            str(found): found
            for found in PersonalLink.objects.filter(study=row).values_list("pk", flat=True)
        }
        link = get_object_or_404(PersonalLink, pk=known.get(pk))
        if links.revoke(link, timezone.now()):
            publishing.log(row, request.user, f"Personal link revoked: {link}.")
            audit.note("link_revoked", actor=request.user, study=row.slug, thing=link)
            messages.success(request, _("Link revoked. It no longer works."))
        else:
            messages.error(request, _("This link has already been used or revoked."))
        return HttpResponseRedirect(request.path)

    # --- hours ------------------------------------------------------------------------------------

    def hours_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        row = study_for(request, pk, "viewer")
        is_owner = may(request.user, row.slug, "owner")
        told = dict(
            zip(opening_hours.DAYS, opening_hours.told_by_day(row.opening_hours), strict=True)
        )
        form = opening_hours.HoursForm(
            request.POST if request.method == "POST" else None,
            initial={"time_zone": row.time_zone, **told},
        )
        if request.method == "POST":
            if not is_owner:
                raise Http404
            if form.is_valid():
                Study.objects.filter(pk=row.pk).update(
                    opening_hours=form.hours, time_zone=form.cleaned_data["time_zone"]
                )
                text = opening_hours.summary(form.hours, form.cleaned_data["time_zone"])
                publishing.log(row, request.user, f"Opening hours: {text}.")
                audit.note(
                    "study_changed", actor=request.user, study=row.slug, detail="opening hours"
                )
                messages.success(request, _("Opening hours: %(hours)s.") % {"hours": text})
                return HttpResponseRedirect(request.path)
        summary = opening_hours.summary(row.opening_hours, row.time_zone)
        return self._page(
            request, row, "hours", _("Opening hours"), form=form, is_owner=is_owner, summary=summary
        )


def made(count: int) -> str:
    return ngettext("%(n)d study was added.", "%(n)d studies were added.", count) % {"n": count}
