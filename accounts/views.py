"""A visitor's own page. Logging in is django-allauth's, with this site's templates."""

from typing import Any

from django.contrib.auth.mixins import LoginRequiredMixin
from django.contrib.messages.views import SuccessMessageMixin
from django.urls import reverse_lazy
from django.utils.translation import gettext_lazy as _
from django.views.generic import UpdateView

from accounts.forms import ProfileForm
from accounts.models import User


class ProfileView(LoginRequiredMixin, SuccessMessageMixin, UpdateView):
    """The visitor's shown name, with links to e-mail address and password."""

    form_class = ProfileForm
    template_name = "accounts/profile.html"
    success_url = reverse_lazy("profile")
    success_message = _("Saved.")

    def get_object(self, queryset: Any = None) -> User:
        """Return a copy, so that a refused change does not show in the page's header."""
        return User.objects.get(pk=self.request.user.pk)
