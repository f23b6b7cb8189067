from experiments.bots.page import HtmlPage

CONSENT = """<!doctype html><html><head><title>A study</title></head><body>
<header><form method="post" action="/out/"><button type="submit">Log out</button></form></header>
<main><h1>Consent</h1><p>You will drive.</p>
<form method="post"><input type="hidden" name="csrfmiddlewaretoken" value="t"><input
type="hidden" name="place" value="1.0.consent">
<label for="id_age">Your age</label><input type="number" name="age" id="id_age"
min="1" max="120" required>
<input type="checkbox" name="agree" id="id_agree" required><label for="id_agree">I agree</label>
<button class="button button--action" type="submit">Agree</button><button
class="button" type="submit" name="go" value="decline">No</button></form>
<a class="button button--action" href="?leaf=2">Next</a><p id="code">ABCD2345</p></main>
<script id="config" type="application/json">{"socket": "/ws/", "who": "A \\u003C B"}</script><script
>nothing()</script></body></html>"""

SURVEY = """<main><form id="survey" method="post"><fieldset><legend>How was it?</legend>
<input type="hidden" name="shown" value="ease"><input
type="radio" name="ease" value="1" id="e1"><label for="e1">Bad</label>
<input type="radio" name="ease" value="2" id="e2"><label for="e2">Good</label><input
type="radio" name="ease" value="~preferred_not" id="e3"></fieldset>
<fieldset disabled><legend>Hidden</legend><input type="hidden" name="shown" value="why"><textarea
name="why"></textarea><input type="radio" name="no" value="1">
</fieldset><select name="land" id="land"><option value="">-</option><option
value="es" selected>Spain</option></select><label for="land">Land</label>
<p class="field__error">Choose one.</p><button type="submit">Send</button></form></main>"""


def test_form_has_its_hidden_inputs_fields_and_buttons():
    page = HtmlPage(CONSENT)
    (form,) = page.forms
    assert form.hidden == [("csrfmiddlewaretoken", "t"), ("place", "1.0.consent")]
    assert {
        name: (field.kind, field.label, field.required) for name, field in form.fields.items()
    } == {
        "age": ("number", "Your age", True),
        "agree": ("checkbox", "", True),
    }
    assert form.fields["agree"].choices[0].label == "I agree"
    assert [(button.name, button.value) for button in form.buttons] == [("", ""), ("go", "decline")]


def test_the_primary_link_and_button_are_found():
    page = HtmlPage(CONSENT)
    assert page.next_form() == (page.forms[0], page.forms[0].buttons[0])
    assert page.next_link == "?leaf=2"
    assert page.button("decline") == (page.forms[0], page.forms[0].buttons[1])


def test_text_is_that_of_the_main_part_without_scripts():
    page = HtmlPage(CONSENT)
    assert "You will drive." in page.text
    assert "nothing" not in page.text
    assert "Log out" not in page.text
    assert page.text_of("code") == "ABCD2345"
    assert page.json["config"] == {"socket": "/ws/", "who": "A < B"}


def test_question_has_its_choices_and_disabled_ones_are_left_out():
    form = HtmlPage(SURVEY).form("survey")
    assert [choice.value for choice in form.fields["ease"].choices] == ["1", "2", "~preferred_not"]
    assert form.fields["ease"].label == "How was it?"
    assert [choice.label for choice in form.fields["land"].choices] == ["-", "Spain"]
    assert set(form.fields) == {"ease", "land"}
    assert form.hidden == [("shown", "ease")]


def test_the_errors_of_a_page_are_read():
    assert HtmlPage(SURVEY).errors == ["Choose one."]


def test_headings_and_errors_that_a_page_hides_are_not_read():
    page = HtmlPage(
        """<main><h1>Giraff</h1><section hidden><h2>The page didn't load</h2></section>
        <p role="alert" hidden>Reload it.</p><p role="alert"></p><h2 hidden>Choose</h2></main>"""
    )
    assert (page.headings, page.errors) == (["Giraff"], [])
