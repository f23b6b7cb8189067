"""The administration's forms of robots and floor plans."""

from collections.abc import Sequence
from typing import Any, ClassVar

from django import forms
from django.conf import settings
from django.core.files.uploadedfile import UploadedFile
from django.template.defaultfilters import filesizeformat
from django.utils.functional import cached_property
from django.utils.text import format_lazy
from django.utils.translation import gettext, gettext_lazy as _

from robots.api.adapter_names import AmbiguousAdapterError, known_names, profile_names
from robots.enrol.connect_command import ASKED, AskedOption
from robots.models import TITLE_LENGTH, FloorPlan, Robot, RobotElsewhere
from robots.plans.floorplans import (
    MAX_IMAGE,
    MAX_PLAN,
    MAX_YAML,
    FloorPlanRefusedError,
    read_upload,
)

OTHER = "other"
TITLES = {
    "simulator": _("Simulated robot"),
    "moos": _("OpenMORA over MOOS"),
    "openmora_mqtt": _("OpenMORA over MQTT"),
    "ros1": _("ROS 1"),
    "ros2": _("ROS 2"),
    "rosbridge": _("ROS over rosbridge"),
    "giraff": "Giraff",
    "rhodon": "Rhodon",
}


class SelectOrOther(forms.MultiWidget):
    """A drop-down of names, and a field for another one, which is that of the drop-down with
    `_other`. static/js/pages/admin/kind.js shows the field when it is needed.
    """

    template_name = "admin/robots/robot/_select_or_other.html"
    use_fieldset = False

    def __init__(self, names: Sequence[str], other: str) -> None:
        choices = [("", _("Choose…"))] + [(name, TITLES.get(name, name)) for name in names]
        select = forms.Select(choices=[*choices, (OTHER, other)])
        self.names = names
        super().__init__({"": select, OTHER: forms.TextInput(attrs={"aria-label": other})})

    def id_for_label(self, id_: str) -> str:
        return f"{id_}_0" if id_ else id_

    def use_required_attribute(self, _initial: Any) -> bool:
        return False  # one of the two is empty

    def decompress(self, value: Any) -> list[str]:
        is_other = value and value not in self.names
        return [OTHER, value] if is_other else [value or "", ""]

    def value_from_datadict(self, data: Any, files: Any, name: str) -> str:
        chosen, other = super().value_from_datadict(data, files, name)
        return (other or "") if chosen == OTHER else (chosen or "")


def adapter_select() -> SelectOrOther:
    return SelectOrOther(offered(), gettext("Another, by its name or .py file"))


def profile_select() -> SelectOrOther:
    return SelectOrOther(profile_names(), gettext("Another, by its name or .toml file"))


class KindForm(forms.ModelForm):
    """What the command for a robot's computer needs to know about the robot."""

    class Meta:
        model = Robot
        fields = ("adapter", "profile")
        labels: ClassVar = {"adapter": _("Robot's software"), "profile": _("Robot's model")}

    def __init__(self, *args: Any, instance: Robot, **options: Any) -> None:
        known = reported_kind(instance) if not instance.adapter else {}
        super().__init__(*args, instance=instance, initial=known, auto_id="connect_%s", **options)
        self.fields["adapter"].widget = adapter_select()
        self.fields["profile"].widget = profile_select()
        for name in ("adapter", "profile"):
            self.fields[name].required = True
            self.fields[name].help_text = ""
        for adapter, asked in ASKED.items():
            for option in asked:
                self.fields[f"{adapter}-{option.name}"] = _field_of(adapter, option, instance)

    def save(self, commit: bool = True) -> Robot:
        words, asked = self.cleaned_data, ASKED.get(self.cleaned_data["adapter"], ())
        given = {option.name: words[f"{words['adapter']}-{option.name}"] for option in asked}
        self.instance.options = {name: value for name, value in given.items() if value}
        if commit:
            self.instance.save(update_fields=["adapter", "profile", "options"])
        return self.instance


def _field_of(adapter: str, option: AskedOption, robot: Robot) -> forms.Field:
    """Return an input for an option; static/js/pages/admin/kind.js shows those of the adapter."""
    given = robot.options.get(option.name, "") if robot.adapter == adapter else ""
    what: dict[str, Any] = {"label": option.label, "required": False, "initial": given}
    attrs = {"data-adapter": adapter, "placeholder": option.default}
    if option.choices:
        widget = forms.Select(attrs={"data-adapter": adapter})
        return forms.ChoiceField(choices=option.choices, widget=widget, **what)
    return forms.CharField(max_length=200, widget=forms.TextInput(attrs=attrs), **what)


def reported_kind(robot: Robot) -> dict[str, str]:
    """Return the adapter and the profile with which the robot connected, if they are known here."""
    sheet = robot.presence.factsheet if isinstance(robot.presence.factsheet, dict) else {}
    adapter = str(sheet.get("adapter", "")).partition(" ")[0]
    profile = str(sheet.get("series", ""))
    if adapter not in offered() or profile not in profile_names():
        return {}
    return {"adapter": adapter, "profile": profile}


DECIMALS = ("turn_minutes", "charge_limit", "max_linear", "max_angular")
NO_DECIMAL = _("This is not a number. Use a decimal point: write 0.6, not 0,6.")
LANGUAGES = [code for code, _name in settings.LANGUAGES if code != settings.LANGUAGE_CODE]
WORDS = ("title", "description")  # of a robot, in each language
TRANSLATED = tuple(f"{word}_{language}" for language in LANGUAGES for word in WORDS)


class PercentField(forms.FloatField):
    """A share from 0 to 1 that people read and write in percent."""

    def prepare_value(self, value: Any) -> Any:
        return round(100.0 * value, 6) if isinstance(value, float) else value

    def clean(self, value: Any) -> float | None:
        percent = super().clean(value)
        return None if percent is None else percent / 100.0

    def has_changed(self, initial: Any, data: Any) -> bool:
        return super().has_changed(self.prepare_value(initial), data)


def _translated() -> dict[str, forms.Field]:
    """Return the fields of TRANSLATED."""
    fields: dict[str, forms.Field] = {}
    for code in LANGUAGES:
        name = dict(settings.LANGUAGES)[code]
        title, description = (
            format_lazy("{} ({})", w, name) for w in (_("Name"), _("Description"))
        )
        fields[f"title_{code}"] = forms.CharField(
            label=title, max_length=TITLE_LENGTH, required=False
        )
        lines = forms.Textarea(attrs={"rows": 3})
        fields[f"description_{code}"] = forms.CharField(
            label=description, widget=lines, required=False
        )
    return fields


Translated: Any = type(forms.Form)("Translated", (forms.Form,), _translated())


class RobotForm(forms.ModelForm, Translated):
    """A robot that never connected cannot be shown to visitors; one that is shown can be hidden."""

    charge_limit = PercentField(
        label=_("Minimum charge for a visit (%)"),
        initial=0.2,
        min_value=0.0,
        max_value=100.0,
        localize=True,
        error_messages={"invalid": NO_DECIMAL},
    )

    class Meta:
        model = Robot
        fields = ("shown_to_visitors",)  # the administration names the others
        labels: ClassVar = {
            "title": _("Name"),
            "name": _("Name in links and commands"),
            "adapter": _("Robot's software"),
            "profile": _("Robot's model"),
        }
        help_texts: ClassVar = {"name": _("Lower-case letters, digits and hyphens.")}
        # accepts a decimal comma in languages that have it
        localized_fields = DECIMALS
        error_messages: ClassVar = {name: {"invalid": NO_DECIMAL} for name in DECIMALS}

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        for name in {*DECIMALS} & self.fields.keys():
            self.fields[name].widget.attrs["inputmode"] = "decimal"
        robot, switch = self.instance, self.fields.get("shown_to_visitors")
        # a robot that is being added has no switch and no presence
        if switch is not None and not (robot.shown_to_visitors or robot.presence.last_seen_at):
            switch.widget.attrs["disabled"] = True  # the page enables it when the robot connects
        for name in {*TRANSLATED} & self.fields.keys():
            word, _separator, language = name.rpartition("_")
            self.initial.setdefault(name, robot.translations.get(language, {}).get(word, ""))

    @cached_property
    def changed_data(self) -> list[str]:
        """The names of changed fields; the administration saves these columns alone."""
        names: list[str] = super().changed_data
        return [*names, "translations"] if {*TRANSLATED} & {*names} else names

    def clean_shown_to_visitors(self) -> bool:
        shown = bool(self.cleaned_data["shown_to_visitors"])
        is_new = self.instance.presence.last_seen_at is None
        if shown and is_new and "shown_to_visitors" in self.changed_data:
            raise forms.ValidationError(
                gettext("This robot hasn't connected yet. Connect it, then show it to visitors.")
            )
        return shown

    def save(self, commit: bool = True) -> Any:
        self.instance.translations = self._translations()
        return super().save(commit)

    def _translations(self) -> dict[str, Any]:
        """Return the robot's translations with those of the form; other languages stay."""
        found = {code: dict(words) for code, words in self.instance.translations.items()}
        for name in {*TRANSLATED} & self.cleaned_data.keys():
            word, _separator, language = name.rpartition("_")
            found.setdefault(language, {})[word] = self.cleaned_data[name]
        kept = {
            code: {w: text for w, text in words.items() if text} for code, words in found.items()
        }
        return {code: words for code, words in kept.items() if words}


def offered() -> tuple[str, ...]:
    """Return the names of adapters on this server, none if two packages use the same name."""
    try:
        return known_names()
    except AmbiguousAdapterError:
        return ()


class RobotElsewhereForm(forms.ModelForm):
    class Meta:
        model = RobotElsewhere
        fields = ("name", "site")

    def clean_site(self) -> str:
        """Accept an address as browsers copy it, with a slash at its end."""
        return str(self.cleaned_data["site"]).removesuffix("/")


class FloorPlanForm(forms.ModelForm):
    """Accepts the two files of ROS map_server and optionally a plan.json, and reads the row's
    fields from them.
    """

    map_file = forms.FileField(
        label=_("Map (YAML)"), required=False, help_text=_("The .yaml file of ROS map_server.")
    )
    image_file = forms.FileField(
        label=_("Map image"), required=False, help_text=_("The PNG or PGM file of this map.")
    )
    plan_file = forms.FileField(
        label=_("Plan (JSON)"),
        required=False,
        help_text=_(
            "plan.json with rooms, doors, charging stations and checkpoints. "
            "Optional: the map works without it."
        ),
    )

    class Meta:
        model = FloorPlan
        fields = ("name", "title")

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.values: dict[str, Any] = {}
        if self.instance._state.adding:
            for name in ("name", "title"):  # a plan.json has both
                self.fields[name].required = False

    def clean_map_file(self) -> bytes | None:
        return _content(self.cleaned_data["map_file"], MAX_YAML)

    def clean_image_file(self) -> bytes | None:
        return _content(self.cleaned_data["image_file"], MAX_IMAGE)

    def clean_plan_file(self) -> bytes | None:
        return _content(self.cleaned_data["plan_file"], MAX_PLAN)

    def clean(self) -> dict[str, Any]:
        cleaned = super().clean() or self.cleaned_data
        files = [cleaned.get(name) for name in ("map_file", "image_file", "plan_file")]
        if self.errors or not (any(files) or self.instance._state.adding):
            return cleaned
        if files[0] is None or files[1] is None:
            raise forms.ValidationError(gettext("Choose the map's YAML file and its image."))
        self.values = self._read(files[0], files[1], files[2], cleaned)
        return cleaned | {"name": self.values["name"], "title": self.values["title"]}

    def _read(
        self, map_file: bytes, image: bytes, plan: bytes | None, cleaned: dict[str, Any]
    ) -> dict[str, Any]:
        adding = self.instance._state.adding
        name = (cleaned.get("name") if adding else self.instance.name) or ""
        try:
            values = read_upload(map_file, image, plan, name=name, title=cleaned.get("title") or "")
        except FloorPlanRefusedError as error:
            raise forms.ValidationError(list(error.problems)) from error
        if name and values["name"] != name:
            words = {"map": values["name"], "name": name}
            raise forms.ValidationError(
                gettext("The plan.json belongs to the map “%(map)s”, not to “%(name)s”.") % words
            )
        return values

    def _post_clean(self) -> None:
        # before the model's validation (unique name), which needs the values from the files
        for field, value in self.values.items():
            setattr(self.instance, field, value)
        super()._post_clean()


def _content(file: UploadedFile | None, limit: int) -> bytes | None:
    if file is None:
        return None
    if file.size is None or file.size > limit:
        text = gettext("The file is larger than %(size)s.") % {"size": filesizeformat(limit)}
        raise forms.ValidationError(text)
    return bytes(file.read())
