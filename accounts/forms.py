"""Forms of sign-up, log-in and profile. Labels are above the fields, and placeholders would repeat
them.
"""

from typing import Any, ClassVar

from allauth.account import forms as allauth
from django import forms
from django.utils.translation import gettext_lazy as _

from accounts.models import User

USER_NAME_HINT = _("Letters, digits and @ . + - _")
USER_NAME_ERROR = _("Use only letters, digits and @ . + - _")
NAME_HINT = _("Shown to people near the robot. Leave blank to use your user name.")
PASSWORD_HINT = _("Use at least 8 characters. Avoid common words and your own name.")
NEW_PASSWORD = {
    "password1": (_("New password"), PASSWORD_HINT),
    "password2": (_("Repeat new password"), ""),
}


def single_line(name: str) -> str:
    """Return a name on one line, with single spaces.

    Raises:
        forms.ValidationError: it has invisible characters, which could disguise one visitor as
            another.
    """
    tidy = " ".join(name.split())
    if not tidy.isprintable():
        raise forms.ValidationError(_("Remove invisible characters."))
    return tidy


class PlainForm(forms.Form):
    """Mixin of allauth's forms: no placeholders; `words` has the label and hint of each field."""

    words: ClassVar[dict[str, tuple[Any, Any]]] = {}

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        for field in self.fields.values():
            field.widget.attrs.pop("placeholder", None)
        for name, (label, hint) in self.words.items():
            if name in self.fields:  # settings can leave fields out
                self.fields[name].label, self.fields[name].help_text = label, hint


class SignUpForm(PlainForm, allauth.SignupForm):
    field_order = ("username", "display_name", "email", "password1")
    display_name = forms.CharField(
        max_length=60, required=False, widget=forms.TextInput(attrs={"autocomplete": "nickname"})
    )
    words = {
        "username": (_("User name"), USER_NAME_HINT),
        "display_name": (_("Name shown to others"), NAME_HINT),
        "email": (
            _("E-mail"),
            _(
                "Only you and the people who run this site see it. It lets you reset a "
                "forgotten password."
            ),
        ),
        "password1": (_("Password"), PASSWORD_HINT),
    }

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.fields["username"].widget.attrs |= {"autocapitalize": "none", "spellcheck": "false"}

    def clean_username(self) -> str:
        """Return the user name; a refused one gets the words of the hint, not Django's."""
        try:
            return str(super().clean_username())
        except forms.ValidationError as error:
            if any(one.code == "invalid" for one in error.error_list):
                raise forms.ValidationError(USER_NAME_ERROR) from error
            raise

    def clean_display_name(self) -> str:
        return single_line(self.cleaned_data["display_name"])


class LogInForm(PlainForm, allauth.LoginForm):
    words = {
        "login": (_("User name or e-mail"), ""),
        "password": (_("Password"), ""),
        "remember": (_("Stay logged in on this device"), ""),
    }

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.fields["login"].widget.attrs |= {
            "autocomplete": "username",
            "autocapitalize": "none",
            "spellcheck": "false",
        }


class AddEmailForm(PlainForm, allauth.AddEmailForm):
    words = {"email": (_("E-mail"), "")}


class ResetPasswordForm(PlainForm, allauth.ResetPasswordForm):
    words = {"email": (_("E-mail"), "")}


class ResetPasswordKeyForm(PlainForm, allauth.ResetPasswordKeyForm):
    words = NEW_PASSWORD


class ChangePasswordForm(PlainForm, allauth.ChangePasswordForm):
    words = {"oldpassword": (_("Current password"), ""), **NEW_PASSWORD}


class SetPasswordForm(PlainForm, allauth.SetPasswordForm):
    """A first password for an account that was created without one."""

    words = {"password1": (_("Password"), PASSWORD_HINT), "password2": (_("Repeat password"), "")}


class ReauthenticateForm(PlainForm, allauth.ReauthenticateForm):
    words = {"password": (_("Password"), "")}


class ProfileForm(forms.ModelForm):
    class Meta:
        model = User
        fields = ("display_name",)
        labels = {"display_name": _("Name shown to others")}
        help_texts = {"display_name": NAME_HINT}
        widgets = {"display_name": forms.TextInput(attrs={"autocomplete": "nickname"})}

    def clean_display_name(self) -> str:
        return single_line(self.cleaned_data["display_name"])
