"""A page as a bot reads it: its words, links, forms and the JSON that it gives to its modules. No
browser, no scripts.
"""

import json
from dataclasses import dataclass, field
from html.parser import HTMLParser
from typing import Any

VOID = frozenset(
    {
        "area",
        "base",
        "br",
        "col",
        "embed",
        "hr",
        "img",
        "input",
        "link",
        "meta",
        "source",
        "track",
        "wbr",
    }
)
QUIET = frozenset({"script", "style", "template"})


@dataclass(frozen=True)
class FormChoice:
    """A radio button, a box to tick or an option of a list."""

    value: str
    label: str
    chosen: bool
    alone: bool = False


@dataclass
class FormField:
    """What takes one answer. `kind` is the type of its input, or `textarea`, `select`; `attributes`
    are those of its first control. In a questionnaire it is part of a `question` of a type.
    """

    name: str
    kind: str
    label: str = ""
    value: str = ""
    question: str = ""
    question_type: str = ""
    attributes: dict[str, str] = field(default_factory=dict)
    choices: list[FormChoice] = field(default_factory=list)
    required: bool = False


PRIMARY = "button--action"  # how the site marks what most people do next


@dataclass(frozen=True)
class Button:
    """What sends a form."""

    text: str
    is_primary: bool = False
    name: str = ""
    value: str = ""
    action: str = ""


@dataclass
class HtmlForm:
    """A form: where it goes, what it holds already (`hidden`), what is asked, and
    how it is sent.
    """

    id: str
    action: str
    method: str
    in_main: bool
    hidden: list[tuple[str, str]] = field(default_factory=list)
    fields: dict[str, FormField] = field(default_factory=dict)
    buttons: list[Button] = field(default_factory=list)
    data: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class HtmlLink:
    """A link and its words."""

    href: str
    text: str
    in_main: bool
    is_primary: bool = False


@dataclass
class HtmlPage:
    """What was found. `text` is what stands in the main part, in order; `json` the blocks of
    `json_script` by their ids.
    """

    title: str = ""
    headings: list[str] = field(default_factory=list)
    text: str = ""
    links: list[HtmlLink] = field(default_factory=list)
    forms: list[HtmlForm] = field(default_factory=list)
    json: dict[str, Any] = field(default_factory=dict)
    errors: list[str] = field(default_factory=list)
    # the words of whatever has an id, in the main part
    by_id: dict[str, str] = field(default_factory=dict)

    @property
    def next_link(self) -> HtmlLink | None:
        """The link that most people follow next."""
        return next((link for link in self.links if link.in_main and link.is_primary), None)

    def next_form(self) -> tuple["HtmlForm", int] | None:
        """Return the form that most people send next, and with which of its buttons."""
        found = (
            (form, number)
            for form in self.main_forms()
            for number, button in enumerate(form.buttons)
            if button.is_primary
        )
        return next(found, None)

    def button(self, value: str) -> tuple["HtmlForm", int] | None:
        """Return the form with a button of this value."""
        found = (
            (form, number)
            for form in self.main_forms()
            for number, button in enumerate(form.buttons)
            if button.value == value
        )
        return next(found, None)

    def form(self, form_id: str) -> HtmlForm | None:
        """Return the form with an id."""
        return next((form for form in self.forms if form.id == form_id), None)

    def main_forms(self) -> list[HtmlForm]:
        """Return the forms that are sent by POST from the main part of the page."""
        return [form for form in self.forms if form.in_main and form.method == "post"]

    @property
    def words(self) -> int:
        """How much there is to read."""
        return len(self.text.split())


@dataclass
class _Open:
    tag: str
    attributes: dict[str, str]
    text: list[str] = field(default_factory=list)


class _PageParser(HTMLParser):
    """Fills a Page. A control's label is the `<label for>` of its id, which may stand before or
    after it, else the fieldset's legend.
    """

    def __init__(self) -> None:
        super().__init__()
        self.page = HtmlPage()
        self.open: list[_Open] = []
        self.labels: dict[str, str] = {}
        self.choices: list[tuple[FormField, int, str]] = []  # whose label is not known yet
        self.described: list[tuple[FormField, str]] = []
        self.words: list[str] = []
        self.form: HtmlForm | None = None
        self.legend = ""

    # --- what the parser tells --------------------------------------------------------------------

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = {name: value or "" for name, value in attrs}
        if tag not in VOID:
            self.open.append(_Open(tag, attributes))
        if tag == "form":
            self._begin_form(attributes)
        elif tag == "fieldset":
            self.legend = ""
        elif tag == "input" and self.form is not None and not self._is_disabled(attributes):
            self._input(self.form, attributes)
        elif (
            tag in {"select", "textarea"}
            and self.form is not None
            and "name" in attributes
            and not self._is_disabled(attributes)
        ):
            kept = self._field(self.form, attributes, tag)
            self.described.append((kept, attributes.get("id", "")))

    def handle_endtag(self, tag: str) -> None:
        while self.open:
            closed = self.open.pop()
            self._closed(closed, " ".join("".join(closed.text).split()))
            if closed.tag == tag:
                break
            if self.open:
                self.open[-1].text += closed.text

    def handle_data(self, data: str) -> None:
        for part in self.open:
            part.text.append(data)
        if (
            self._inside("main")
            and not any(part.tag in QUIET for part in self.open)
            and not self._is_hidden()
        ):
            self.words.append(data)

    def finish(self) -> HtmlPage:
        """Return the page, with all labels in their places."""
        self.close()
        for asked, index, identity in self.choices:
            asked.choices[index] = FormChoice(
                asked.choices[index].value,
                self.labels.get(identity, ""),
                asked.choices[index].chosen,
                asked.choices[index].alone,
            )
        for asked, identity in self.described:
            asked.label = self.labels.get(identity, asked.label)
        self.page.text = " ".join(" ".join(self.words).split())
        return self.page

    # --- small steps ------------------------------------------------------------------------------

    def _inside(self, tag: str) -> bool:
        return any(part.tag == tag for part in self.open)

    def _said_around(self, name: str) -> str:
        """Return an attribute of the innermost element that has it."""
        around = (part.attributes[name] for part in reversed(self.open) if name in part.attributes)
        return next(around, "")

    def _is_hidden(self, *closed: _Open) -> bool:
        return any("hidden" in part.attributes for part in (*self.open, *closed))

    def _is_disabled(self, attributes: dict[str, str]) -> bool:
        return "disabled" in attributes or any(
            part.tag == "fieldset" and "disabled" in part.attributes for part in self.open
        )

    def _begin_form(self, attributes: dict[str, str]) -> None:
        data = {name: value for name, value in attributes.items() if name.startswith("data-")}
        self.form = HtmlForm(
            attributes.get("id", ""),
            attributes.get("action", ""),
            attributes.get("method", "get").lower(),
            self._inside("main"),
            data=data,
        )
        self.page.forms.append(self.form)

    def _field(self, form: HtmlForm, attributes: dict[str, str], kind: str) -> FormField:
        name = attributes["name"]
        new = FormField(
            name,
            kind,
            self.legend,
            attributes.get("value", ""),
            self._said_around("data-question"),
            self._said_around("data-kind"),
            dict(attributes),
        )
        kept = form.fields.setdefault(name, new)
        kept.required |= "required" in attributes or attributes.get("aria-required") == "true"
        return kept

    def _input(self, form: HtmlForm, attributes: dict[str, str]) -> None:
        name, kind = attributes.get("name"), attributes.get("type", "text")
        if kind in {"submit", "image"}:
            form.buttons.append(
                Button(
                    attributes.get("value", ""),
                    False,
                    name or "",
                    attributes.get("value", ""),
                    attributes.get("formaction", ""),
                )
            )
        elif name is None:
            return
        elif kind == "hidden":
            form.hidden.append((name, attributes.get("value", "")))
        elif kind in {"radio", "checkbox"}:
            kept = self._field(form, attributes, kind)
            self.choices.append((kept, len(kept.choices), attributes.get("id", "")))
            kept.choices.append(
                FormChoice(
                    attributes.get("value", "on"),
                    "",
                    "checked" in attributes,
                    "data-alone" in attributes,
                )
            )
        else:
            self.described.append((self._field(form, attributes, kind), attributes.get("id", "")))

    def _closed(self, part: _Open, text: str) -> None:
        if "id" in part.attributes and self._inside("main"):
            self.page.by_id[part.attributes["id"]] = text
        match part.tag:
            case "label":
                self.labels[part.attributes.get("for", "")] = text
            case "legend":
                self.legend = text
            case "a":
                is_primary = PRIMARY in part.attributes.get("class", "").split()
                self.page.links.append(
                    HtmlLink(
                        part.attributes.get("href", ""), text, self._inside("main"), is_primary
                    )
                )
            case "h1" | "h2" if not self._is_hidden(part):
                self.page.headings.append(text)
            case "title":
                self.page.title = text
            case "form":
                self.form = None
            case "script" if (
                part.attributes.get("type") == "application/json" and "id" in part.attributes
            ):
                self.page.json[part.attributes["id"]] = json.loads(text)
            case _:
                self._closed_in_form(part, text)

    def _closed_in_form(self, part: _Open, text: str) -> None:
        classes = part.attributes.get("class", "").split()
        is_error = "field__error" in classes or part.attributes.get("role") == "alert"
        if is_error and text and not self._is_hidden(part):
            self.page.errors.append(text)
        if self.form is None:
            return
        if part.tag == "button" and part.attributes.get("type", "submit") == "submit":
            self.form.buttons.append(
                Button(
                    text,
                    PRIMARY in classes,
                    part.attributes.get("name", ""),
                    part.attributes.get("value", ""),
                    part.attributes.get("formaction", ""),
                )
            )
        elif part.tag == "option":
            self._option(part, text)
        elif (
            part.tag == "textarea"
            and (written := self.form.fields.get(part.attributes.get("name", ""))) is not None
        ):
            written.value = text

    def _option(self, part: _Open, text: str) -> None:
        select = next((outer for outer in reversed(self.open) if outer.tag == "select"), None)
        if select is not None and self.form is not None and "name" in select.attributes:
            value = part.attributes.get("value", text)
            if (asked := self.form.fields.get(select.attributes["name"])) is not None:
                asked.choices.append(FormChoice(value, text, "selected" in part.attributes))


def read(html: str) -> HtmlPage:
    """Return what a page holds."""
    reader = _PageParser()
    reader.feed(html)
    return reader.finish()
