"""A page as a bot reads it: its words, links, forms and the JSON that it gives to its modules. No
scripts run.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from html.parser import HTMLParser
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder

VOID = frozenset(  # elements without an end tag
    "area base br col embed hr img input link meta source track wbr".split()  # noqa: SIM905
)
DEFAULT_KIND = {"input": "text", "button": "submit"}  # of a control without a type
NOT_SHOWN = frozenset({"script", "style", "template"})
PRIMARY = "button--action"  # the class by which the site marks what most people do next


@dataclass(frozen=True)
class FormChoice:
    """A radio button, checkbox or option of a list; one that is `alone` excludes others."""

    value: str
    label: str
    alone: bool = False


@dataclass
class FormField:
    """A control for one answer. `kind` is the type of its input, or `textarea`, `select`;
    `attributes` are those of its first control. In a questionnaire it is part of a `question` of a
    type.
    """

    name: str
    kind: str
    label: str = ""
    question: str = ""
    question_type: str = ""
    attributes: dict[str, str] = field(default_factory=dict)
    choices: list[FormChoice] = field(default_factory=list)
    required: bool = False


@dataclass(frozen=True)
class Button:
    """A button that sends a form; `action` is its own address, empty for that of the form."""

    is_primary: bool = False
    name: str = ""
    value: str = ""
    action: str = ""


@dataclass
class HtmlForm:
    """A form; `hidden` are the names and values of its hidden inputs."""

    id: str
    action: str
    hidden: list[tuple[str, str]] = field(default_factory=list)
    fields: dict[str, FormField] = field(default_factory=dict)
    buttons: list[Button] = field(default_factory=list)


class _TreeParser(HTMLParser):
    """Builds the elements. An end tag also closes the elements that are still open inside."""

    def __init__(self) -> None:
        super().__init__()
        self._builder, self._open = TreeBuilder(), list[str]()
        self._builder.start("page", {})

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._builder.start(tag, {name: value or "" for name, value in attrs})
        if tag in VOID:
            self._builder.end(tag)
        else:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        while tag in self._open:
            self._builder.end(last := self._open.pop())
            if last == tag:
                break

    def handle_data(self, data: str) -> None:
        self._builder.data(data)

    def root(self) -> Element:
        self.close()
        for tag in (*reversed(self._open), "page"):
            self._builder.end(tag)
        return self._builder.close()


class HtmlPage:
    """A page. A control's label is the `<label for>` of its id, else the legend around it. `forms`
    are those of the main part that are sent by POST, `json` the blocks of `json_script` by id.
    """

    def __init__(self, html: str = "") -> None:
        parser = _TreeParser()
        parser.feed(html)
        self._root = parser.root()
        main = self._root.find(".//main")
        self._main = Element("main") if main is None else main
        self._around = {inner: outer for outer in self._root.iter() for inner in outer}
        self._labels = {one.get("for", ""): _text(one) for one in self._root.iter("label")}
        posted = (one for one in self._main.iter("form") if one.get("method", "").lower() == "post")
        self.forms = [self._form(one) for one in posted]
        self.json: dict[str, Any] = {
            one.attrib["id"]: json.loads("".join(one.itertext()))
            for one in self._root.iter("script")
            if one.get("type") == "application/json" and "id" in one.attrib
        }

    @property
    def title(self) -> str:
        return _words(self._root.findtext(".//title", ""))

    @property
    def headings(self) -> list[str]:
        return [_text(one) for one in self._visible() if one.tag in {"h1", "h2"}]

    @property
    def errors(self) -> list[str]:
        texts = (
            _text(one)
            for one in self._visible()
            if "field__error" in _classes(one) or one.get("role") == "alert"
        )
        return [text for text in texts if text]

    @cached_property
    def text(self) -> str:
        """The words of the main part."""
        return _words("".join(_shown(self._main)))

    @property
    def links(self) -> list[str]:
        """The addresses of all links."""
        return [one.get("href", "") for one in self._root.iter("a")]

    @property
    def next_link(self) -> str | None:
        """The address of the link that most people follow next."""
        found = (one for one in self._main.iter("a") if PRIMARY in _classes(one))
        return next((one.get("href", "") for one in found), None)

    def text_of(self, identity: str) -> str:
        """Return the text of the element of the main part with an id; "" without one."""
        found = self._main.find(f".//*[@id='{identity}']")
        return "" if found is None else _text(found)

    def form(self, form_id: str) -> HtmlForm | None:
        return next((form for form in self.forms if form.id == form_id), None)

    def next_form(self) -> tuple[HtmlForm, Button] | None:
        """Return the form that most people send next, and the button for it."""
        return self._form_with(lambda button: button.is_primary)

    def button(self, value: str) -> tuple[HtmlForm, Button] | None:
        """Return the form with a button of this value, and that button."""
        return self._form_with(lambda button: button.value == value)

    def _form_with(self, is_wanted: Callable[[Button], bool]) -> tuple[HtmlForm, Button] | None:
        buttons = ((form, button) for form in self.forms for button in form.buttons)
        return next((found for found in buttons if is_wanted(found[1])), None)

    # --- reading ----------------------------------------------------------------------------------

    def _visible(self) -> Iterator[Element]:
        for one in self._root.iter():
            if not any("hidden" in around.attrib for around in self._lineage(one)):
                yield one

    def _form(self, element: Element) -> HtmlForm:
        form = HtmlForm(element.get("id", ""), element.get("action", ""))
        for control in element.iter():
            if control.tag in {"input", "select", "textarea", "button"}:
                self._add(form, control)
        return form

    def _add(self, form: HtmlForm, control: Element) -> None:
        kind = control.get("type") or DEFAULT_KIND.get(control.tag, control.tag)
        name, value = control.get("name", ""), control.get("value", "")
        if kind in {"submit", "image"}:
            address = control.get("formaction", "")
            form.buttons.append(Button(PRIMARY in _classes(control), name, value, address))
        elif not name or control.tag == "button" or self._is_disabled(control):
            return
        elif kind == "hidden":
            form.hidden.append((name, value))
        else:
            self._add_to_field(form, control, name, kind)

    def _add_to_field(self, form: HtmlForm, control: Element, name: str, kind: str) -> None:
        label = self._labels.get(control.get("id", ""), "")
        legends = (one.find("legend") for one in self._lineage(control) if one.tag == "fieldset")
        legend = next((_text(one) for one in legends if one is not None), "")
        is_choice = kind in {"radio", "checkbox"}
        question, of_type = (self._nearest(control, f"data-{one}") for one in ("question", "kind"))
        field_label = legend if is_choice else label or legend
        new = FormField(name, kind, field_label, question, of_type, dict(control.attrib))
        added = form.fields.setdefault(name, new)
        added.required |= "required" in control.attrib or control.get("aria-required") == "true"
        if is_choice:
            is_alone = "data-alone" in control.attrib
            added.choices.append(FormChoice(control.get("value", "on"), label, is_alone))
        for option in control.iter("option"):
            text = _text(option)
            added.choices.append(FormChoice(option.get("value", text), text))

    def _lineage(self, element: Element | None) -> Iterator[Element]:
        """Yield an element and those around it, the innermost first."""
        while element is not None:
            yield element
            element = self._around.get(element)

    def _nearest(self, element: Element, attribute: str) -> str:
        around = self._lineage(element)
        return next((one.attrib[attribute] for one in around if attribute in one.attrib), "")

    def _is_disabled(self, control: Element) -> bool:
        disabled = (one for one in self._lineage(control) if "disabled" in one.attrib)
        return any(one is control or one.tag == "fieldset" for one in disabled)


def _classes(element: Element) -> list[str]:
    return element.get("class", "").split()


def _text(element: Element) -> str:
    return _words("".join(element.itertext()))


def _words(text: str) -> str:
    return " ".join(text.split())


def _shown(element: Element) -> Iterator[str]:
    """Yield the text that a reader sees, with a space after each element."""
    if element.tag not in NOT_SHOWN and "hidden" not in element.attrib:
        yield element.text or ""
        for inner in element:
            yield from _shown(inner)
            yield f" {inner.tail or ''}"
