"""The administration's forms of robots and floor plans."""

from typing import Any, ClassVar

from django import forms
from django.core.files.uploadedfile import UploadedFile
from django.template.defaultfilters import filesizeformat
from django.utils.html import format_html, format_html_join
from django.utils.safestring import SafeString
from django.utils.translation import gettext, gettext_lazy as _

from robots.api.adapter_names import AmbiguousAdapterError, known_names
from robots.models import FloorPlan, Robot, RobotElsewhere
from robots.plans.floorplans import (
    MAX_IMAGE,
    MAX_PLAN,
    MAX_YAML,
    FloorPlanRefusedError,
    read_upload,
)


class AdapterInput(forms.TextInput):
    """A text field that suggests the adapters that are installed on the server. It accepts others,
    which may be installed on the robot's computer.
    """

    def render(self, name: str, value: Any, attrs: Any = None, renderer: Any = None) -> SafeString:
        known = f"{name}-known"
        field = super().render(name, value, {**(attrs or {}), "list": known}, renderer)
        options = format_html_join("", '<option value="{}"></option>', ((n,) for n in offered()))
        return format_html('{}<datalist id="{}">{}</datalist>', field, known, options)


DECIMALS = ("turn_minutes", "charge_limit", "max_linear", "max_angular")
NO_DECIMAL = _("This is not a number. Use a decimal point: write 0.6, not 0,6.")


class RobotForm(forms.ModelForm):
    """A robot that never connected cannot be shown to visitors; one that is shown can be hidden."""

    class Meta:
        model = Robot
        fields = ("shown_to_visitors",)  # the administration names the others
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

    def clean_translations(self) -> dict[str, Any]:
        return self.cleaned_data["translations"] or {}

    def clean_shown_to_visitors(self) -> bool:
        shown = bool(self.cleaned_data["shown_to_visitors"])
        is_new = self.instance.presence.last_seen_at is None
        if shown and is_new and "shown_to_visitors" in self.changed_data:
            raise forms.ValidationError(
                gettext("This robot hasn't connected yet. Connect it, then show it to visitors.")
            )
        return shown


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
