"""Forms of sign-up, log-in and profile. Labels stand above fields, so placeholders would only say
the same thing twice.
"""

from typing import Any

from allauth.account import forms as allauth
from django import forms
from django.utils.translation import gettext_lazy as _

from accounts.models import User

PASSWORD_HINT = _("Use at least 8 characters. Avoid common words and your own name.")


def single_line(name: str) -> str:
    """Return a name with its blanks tidied; it is shown on one line.

    Raises:
        forms.ValidationError: when it holds characters that cannot be seen, which could disguise
        one visitor as another.
    """
    tidy = " ".join(name.split())
    if not tidy.isprintable():
        raise forms.ValidationError(_("Remove invisible characters."))
    return tidy


class PlainForm(forms.Form):
    """Mixin: no placeholders."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        for field in self.fields.values():
            field.widget.attrs.pop("placeholder", None)

    def describe(self, name: str, label: Any, hint: Any = "") -> None:
        """Give a field its words, if the settings left it in the form."""
        if name in self.fields:
            self.fields[name].label = label
            self.fields[name].help_text = hint


class SignUpForm(PlainForm, allauth.SignupForm):
    """User name, shown name, perhaps an e-mail address, and one password."""

    field_order = ("username", "display_name", "email", "password1")
    display_name = forms.CharField(
        max_length=60, required=False, widget=forms.TextInput(attrs={"autocomplete": "nickname"})
    )

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.describe("username", _("User name"), _("Letters, digits and @ . + - _"))
        self.describe(
            "display_name",
            _("Name shown to others"),
            _("Shown to people near the robot. Leave blank to use your user name."),
        )
        self.describe(
            "email",
            _("E-mail"),
            _(
                "Only you and the people who run this site see it. It lets you reset a "
                "forgotten password."
            ),
        )
        self.describe("password1", _("Password"), PASSWORD_HINT)
        self.fields["username"].widget.attrs |= {"autocapitalize": "none", "spellcheck": "false"}

    def clean_display_name(self) -> str:
        """Return the shown name as one visible line."""
        return single_line(self.cleaned_data["display_name"])


class LogInForm(PlainForm, allauth.LoginForm):
    """User name or e-mail address, and the password."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.describe("login", _("User name or e-mail"))
        self.describe("password", _("Password"))
        self.describe("remember", _("Stay logged in on this device"))
        self.fields["login"].widget.attrs |= {
            "autocomplete": "username",
            "autocapitalize": "none",
            "spellcheck": "false",
        }


class AddEmailForm(PlainForm, allauth.AddEmailForm):
    """One more e-mail address."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.describe("email", _("E-mail"))


class ResetPasswordForm(PlainForm, allauth.ResetPasswordForm):
    """Where the link to a new password goes."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.describe("email", _("E-mail"))


class ResetPasswordKeyForm(PlainForm, allauth.ResetPasswordKeyForm):
    """A new password, twice, behind the link."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.describe("password1", _("New password"), PASSWORD_HINT)
        self.describe("password2", _("Repeat new password"))


class ChangePasswordForm(PlainForm, allauth.ChangePasswordForm):
    """The old password, and the new one twice."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.describe("oldpassword", _("Current password"))
        self.describe("password1", _("New password"), PASSWORD_HINT)
        self.describe("password2", _("Repeat new password"))


class SetPasswordForm(PlainForm, allauth.SetPasswordForm):
    """A first password for an account that was made without one."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.describe("password1", _("Password"), PASSWORD_HINT)
        self.describe("password2", _("Repeat password"))


class ReauthenticateForm(PlainForm, allauth.ReauthenticateForm):
    """The password once more, before something that matters."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.describe("password", _("Password"))


class ProfileForm(forms.ModelForm):
    """What a visitor may change about themselves."""

    class Meta:
        model = User
        fields = ("display_name",)
        labels = {"display_name": _("Name shown to others")}
        help_texts = {
            "display_name": _("Shown to people near the robot. Leave blank to use your user name.")
        }
        widgets = {"display_name": forms.TextInput(attrs={"autocomplete": "nickname"})}

    def clean_display_name(self) -> str:
        """Return the shown name as one visible line."""
        return single_line(self.cleaned_data["display_name"])
