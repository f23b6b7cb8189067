import re

import pytest
from django.core import mail
from django.test import Client
from django.urls import reverse

from accounts.models import User
from accounts.password_guesses import ACCOUNT_GUESSES, DEVICE_COOKIE
from tests.support.browsers.html_page import faults, read
from tests.support.people import PASSWORD, person

pytestmark = pytest.mark.django_db
FRESH = "eleven blue ladders"


def log_in(client, login, password=PASSWORD, address="127.0.0.1", **more):
    form = {"login": login, "password": password} | more
    return client.post(reverse("account_login"), form, REMOTE_ADDR=address)


def signed_in(client) -> bool:
    return "_auth_user_id" in client.session


@pytest.mark.parametrize("login", ["ada", "ada@example.org", "ADA@example.org"])
def test_a_visitor_logs_in_by_user_name_or_by_address(client, login):
    person("ada", email="ada@example.org")
    assert log_in(client, login).url == reverse("home")
    assert signed_in(client)


def test_log_in_leads_on_to_the_page_that_was_asked_for(client):
    person()
    page = client.get(reverse("profile"))
    assert page.url == f"{reverse('account_login')}?next={reverse('profile')}"
    assert log_in(client, "ada", next=reverse("profile")).url == reverse("profile")


def test_log_in_leads_to_no_other_site(client):
    person()
    assert log_in(client, "ada", next="//elsewhere.example/").url == reverse("home")


@pytest.mark.parametrize(
    ("login", "password"), [("ada", "wrong"), ("nobody", PASSWORD), ("", ""), ("ada", "")]
)
def test_a_wrong_log_in_shows_an_error(client, login, password):
    person()
    response = log_in(client, login, password)
    assert response.status_code == 200
    assert not signed_in(client)
    page = read(response)
    assert any(e.attributes.get("role") == "alert" and e.text.strip() for e in page.elements)
    assert faults(page) == []


def test_an_unknown_name_and_a_wrong_password_are_answered_alike(client):
    person()
    answers = [log_in(client, login, "wrong") for login in ("ada", "nobody")]
    errors = [answer.context["form"].non_field_errors() for answer in answers]
    assert errors[0] == errors[1]


def test_log_in_to_a_closed_account_shows_that_it_is_closed(client):
    person(is_active=False)
    page = client.get(log_in(client, "ada").url)
    assert "This account is closed" in read(page).text
    assert not signed_in(client)


def test_guessing_is_stopped_even_when_the_sixth_guess_is_right(client):
    person()
    for _ in range(5):
        log_in(client, "ada", "wrong")
    refused = log_in(client, "ada")
    assert refused.status_code == 429
    assert 300 <= int(refused["Retry-After"]) <= 330
    assert not signed_in(client)
    page = read(refused)
    alerts = [e.text for e in page.elements if e.attributes.get("role") == "alert"]
    assert any("Too many failed login attempts" in text for text in alerts)
    assert faults(page) == []


def guess_from_elsewhere(client, tries):
    """Send wrong passwords of ada, five from each of many addresses, and return the statuses."""
    addresses = [f"198.51.100.{number // 5 + 1}" for number in range(tries)]
    return [log_in(client, "ada", "wrong", address).status_code for address in addresses]


def log_out(client):
    client.post(reverse("account_logout"))


def test_wrong_passwords_from_one_address_do_not_lock_the_owner_out(client):
    person()
    attacker = Client()
    assert guess_from_elsewhere(attacker, 5) == [200] * 5
    assert log_in(attacker, "ada", "wrong", "198.51.100.1").status_code == 429
    assert log_in(client, "ada").status_code == 302


def test_guessing_from_many_addresses_is_bounded_for_each_account(client):
    person("ada", email="ada@example.org")
    allowed = ACCOUNT_GUESSES.limit
    codes = guess_from_elsewhere(client, allowed + 3)
    assert codes == [200] * allowed + [429] * 3
    refused = log_in(client, "ada@example.org", address="203.0.113.9")  # the same account
    assert refused.status_code == 429
    assert 300 < int(refused["Retry-After"]) <= 3960
    assert not signed_in(client)


def test_guessing_elsewhere_does_not_lock_out_a_device_that_logged_in_before(client):
    person()
    person("ben")
    assert log_in(client, "ada").status_code == 302
    log_out(client)
    assert log_in(client, "ben").status_code == 302  # another person on the same device
    log_out(client)
    guess_from_elsewhere(Client(), ACCOUNT_GUESSES.limit)
    assert log_in(Client(), "ada", address="203.0.113.9").status_code == 429
    assert log_in(client, "ada", address="203.0.113.9").status_code == 302


def test_known_device_gets_five_guesses_for_its_own_account_only(client):
    person()
    person("mallory")
    assert log_in(client, "mallory").status_code == 302
    log_out(client)
    codes = [log_in(client, "mallory", "wrong").status_code for _ in range(6)]
    assert codes == [200] * 5 + [429]
    guess_from_elsewhere(Client(), ACCOUNT_GUESSES.limit)
    assert log_in(client, "ada", address="203.0.113.9").status_code == 429


def test_a_changed_device_cookie_makes_no_device_known(client):
    person()
    log_in(client, "ada")
    log_out(client)
    client.cookies[DEVICE_COOKIE] = client.cookies[DEVICE_COOKIE].value[:-1] + "_"
    guess_from_elsewhere(Client(), ACCOUNT_GUESSES.limit)
    assert log_in(client, "ada", address="203.0.113.9").status_code == 429


def test_device_that_resets_the_password_can_log_in_while_others_guess(client):
    person("ada", email="ada@example.org")
    guess_from_elsewhere(Client(), ACCOUNT_GUESSES.limit)
    _link, page = reset_link(client)
    client.post(page.request["PATH_INFO"], {"password1": FRESH, "password2": FRESH})
    assert log_in(client, "ada", FRESH, "203.0.113.9").status_code == 302


def reset_link(client):
    """Return the link in the e-mail that resets Ada's password, and the page behind it."""
    sent = client.post(reverse("account_reset_password"), {"email": "ada@example.org"})
    assert sent.status_code == 302
    link = re.search(r"https?://testserver(/\S+)", mail.outbox[0].body)[1]
    return link, client.get(link, follow=True)


def test_device_cookie_is_for_log_in_pages_alone_and_names_no_account(client):
    ada = person()
    cookie = log_in(client, "ada").cookies[DEVICE_COOKIE]
    assert (cookie["path"], cookie["httponly"], cookie["samesite"]) == ("/accounts/", True, "Lax")
    assert str(ada.pk) not in cookie.value
    assert "ada" not in cookie.value


def test_a_log_in_after_a_few_wrong_guesses_succeeds(client):
    person()
    assert [log_in(client, "ada", "wrong").status_code for _ in range(4)] == [200] * 4
    assert log_in(client, "ada").status_code == 302


def test_a_script_that_guesses_reads_the_same_code(client):
    person()
    script, wrong = {"x-requested-with": "XMLHttpRequest"}, {"login": "ada", "password": "wrong"}
    url = reverse("account_login")
    codes = [client.post(url, wrong, headers=script).status_code for _ in range(6)]
    assert codes == [400] * 5 + [429]


def test_wrong_passwords_of_a_logged_in_user_are_counted_too(client):
    client.force_login(person())
    url = reverse("account_reauthenticate")
    codes = [client.post(url, {"password": "wrong"}).status_code for _ in range(6)]
    assert codes[:5] == [200] * 5
    assert codes[5] == 429


@pytest.mark.parametrize(
    ("name", "data", "limit"),
    [("account_reset_password", {"email": "ada@example.org"}, 5), ("account_login", {}, 30)],
)
def test_rate_limited_forms_of_accounts_send_retry_after(client, name, data, limit):
    answers = [client.post(reverse(name), data) for _ in range(limit + 1)]
    assert 429 not in {answer.status_code for answer in answers[:limit]}
    assert (answers[limit].status_code, answers[limit]["Retry-After"]) == (429, "60")
    assert "Too many attempts" in read(answers[limit]).text


def test_a_session_ends_with_the_browser_unless_the_visitor_wants_to_stay(client):
    person()
    log_in(client, "ada")
    assert client.session.get_expire_at_browser_close()
    client.logout()
    log_in(client, "ada", remember="on")
    assert not client.session.get_expire_at_browser_close()


def test_logging_out_takes_a_post(client):
    client.force_login(person())
    assert "Log out?" in read(client.get(reverse("account_logout"))).text
    assert signed_in(client)
    assert client.post(reverse("account_logout")).url == reverse("home")
    assert not signed_in(client)


def test_a_forgotten_password_is_replaced_through_a_link_that_works_once(client):
    person("ada", email="ada@example.org")
    link, page = reset_link(client)
    assert "Choose a new password" in read(page).text
    client.post(page.request["PATH_INFO"], {"password1": FRESH, "password2": FRESH})
    assert User.objects.get().check_password(FRESH)
    assert "This link has expired" in read(client.get(link, follow=True)).text


def test_e_mail_for_a_new_password_is_from_the_site_by_its_name(client, settings):
    settings.DEFAULT_FROM_EMAIL = "robots@example.org"
    person("ada", email="ada@example.org")
    reset_link(client)
    message = mail.outbox[0]
    assert message.subject == "Reset your password"
    assert message.from_email == "Telepresence <robots@example.org>"
    assert message.body.startswith("Hello,")
    assert "Your user name is ada." in message.body


def test_asking_for_a_new_password_does_not_tell_who_has_an_account(client):
    person("ada", email="ada@example.org")
    reset, emails = reverse("account_reset_password"), ("ada@example.org", "nobody@example.org")
    first, second = (client.post(reset, {"email": email}).url for email in emails)
    assert first == second


def test_a_password_is_changed_with_the_old_one(client):
    client.force_login(person())
    url, fresh = reverse("account_change_password"), {"password1": FRESH, "password2": FRESH}
    assert client.post(url, {"oldpassword": "wrong"} | fresh).status_code == 200
    assert client.post(url, {"oldpassword": PASSWORD} | fresh).status_code == 302
    assert User.objects.get().check_password(FRESH)


def test_the_administration_has_no_door_of_its_own_at_which_guesses_are_not_counted(client):
    guess = {"username": "boss", "password": "guess", "next": "/admin/"}
    answer = client.post(reverse("admin:login"), guess)
    assert (answer.status_code, answer.url.partition("?")[0]) == (302, reverse("account_login"))
    client.force_login(person())
    assert client.get(reverse("admin:login")).status_code == 403


def test_behind_a_proxy_of_ours_each_visitors_guesses_are_counted_alone(client, settings):
    settings.TRUSTED_PROXIES = ["127.0.0.1"]
    settings.ACCOUNT_RATE_LIMITS = {"login": "3/m/ip"}

    def code(address):
        guess, url = {"login": "ada", "password": "guess"}, reverse("account_login")
        return client.post(url, guess, headers={"x-forwarded-for": address}).status_code

    assert [code("198.51.100.7") for _ in range(4)] == [200, 200, 200, 429]
    assert code("198.51.100.8") == 200
    assert code("198.51.100.7, 198.51.100.8") == 200  # the first address is only a claim
