"""The administration's forms of a study, filled in as a browser does it."""

from django.http import QueryDict

from tests.support.browsers.html_page import Page, read


def buttons(page: Page) -> list[str]:
    """Return the texts of the buttons and of the links that look like one, in the main part."""
    main = page.all("main")[0].text
    found = [one for one in page.elements if "button" in one.attributes.get("class", "").split()]
    return [one.text.strip() for one in found if one.text.strip() in main]


def form_of(response) -> QueryDict:
    """Return what a browser would send of the builder's form of a page, or else of the last one, as
    it is shown, without its buttons.
    """
    page = read(response)
    data = QueryDict(mutable=True)
    starts = [
        n
        for n, element in enumerate(page.elements)
        if element.tag == "form" and element.attributes.get("method") == "post"
    ]
    built = [n for n in starts if page.elements[n].attributes.get("id") == "part"]
    start = (built or starts)[-1]
    end = next((n for n in starts if n > start), None)
    select = ""
    for element in page.elements[start:end]:
        a = element.attributes
        if element.tag == "select":
            select = a["name"]
            data[select] = ""
        elif element.tag == "option" and "selected" in a:
            data[select] = a.get("value", "")
        elif element.tag == "textarea":
            data[a["name"]] = element.text
        elif (
            element.tag == "input"
            and a.get("type") not in {"submit", "file", "radio"}
            and "name" in a
            and (a.get("type") != "checkbox" or "checked" in a)
        ):
            default = "on" if a.get("type") == "checkbox" else ""
            data.appendlist(a["name"], a.get("value", default))
    return data
