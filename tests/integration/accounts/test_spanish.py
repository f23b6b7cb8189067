"""What Django and django-allauth say in Spanish, where people meet it: as tú, as this site does."""

import gettext
import re
from pathlib import Path

import allauth
import django
import pytest
from django.conf import settings
from django.core import mail
from django.urls import reverse

from tests.support.browsers.html_page import read
from tests.support.people import PASSWORD, person

pytestmark = pytest.mark.django_db
SPANISH = {"accept-language": "es"}
USTED = re.compile(
    r"\b(usted|por favor|está seguro|asegúrese|compruebe|corrija|escoja|escriba|ingrese|introduzca|"
    r"inténtelo|mantenga|observe|pulse|puede volver|seleccione|"
    r"su (contraseña|cuenta|correo|dirección|usuario))\b",
    re.IGNORECASE,
)


def page_text(client, address: str, form: dict[str, str] | None = None) -> str:
    """Return what a Spanish reader reads after they have sent a form, or opened a page."""
    answer = (
        client.get(address, headers=SPANISH)
        if form is None
        else client.post(address, form, headers=SPANISH, follow=True)
    )
    text = read(answer).text
    assert USTED.findall(text) == [], text
    return text


def test_the_forms_of_an_account_address_their_reader_as_tu(client):
    signup = reverse("account_signup")
    for password in ("short", "password1", "ada-lovelace"):
        form = {"username": "ada-lovelace", "email": "no address", "password1": password}
        assert "Escribe una dirección de correo" in page_text(client, signup, form)
    page_text(client, signup, {"username": "a b", "password1": PASSWORD})
    person(email="ada@example.org")
    for login in ("ada", "ada@example.org"):
        wrong = {"login": login, "password": "wrong"}
        assert "no son correct" in page_text(client, reverse("account_login"), wrong)
    client.force_login(person("bea"))
    wrong = {"oldpassword": "wrong", "password1": "password1", "password2": "other"}
    text = page_text(client, reverse("account_change_password"), wrong)
    assert "Escribe tu contraseña actual." in text
    assert "Cerrar sesión" in text or "Salir" in text
    assert "Has cerrado la sesión." in page_text(client, reverse("account_logout"), {})


def test_the_mails_of_an_account_address_their_reader_as_tu(client):
    person(email="ada@example.org")
    page_text(client, reverse("account_reset_password"), {"email": "ada@example.org"})
    page_text(client, reverse("account_reset_password"), {"email": "nobody@example.org"})
    page_text(client, reverse("account_signup"), {"username": "eva", "email": "ada@example.org"})
    assert len(mail.outbox) == 2
    for message in mail.outbox:
        assert USTED.findall(f"{message.subject}\n{message.body}") == [], message.body
        assert re.search(r"\b(Recibes|Abre) este", message.body), message.body


def test_the_administration_addresses_its_reader_as_tu(client):
    client.force_login(person("root", is_staff=True, is_superuser=True))
    row = person("ada")
    page_text(client, "/admin/accounts/user/")
    assert "Corrige" in page_text(client, "/admin/accounts/user/add/", {"username": "ada"})
    assert "¿Seguro que quieres borrar" in page_text(
        client, f"/admin/accounts/user/{row.pk}/delete/"
    )
    page_text(client, f"/admin/accounts/user/{row.pk}/password/")
    chosen = {"action": "delete_selected", "_selected_action": str(row.pk)}
    assert "¿Seguro que quieres borrar" in page_text(client, "/admin/accounts/user/", chosen)
    assert "Selecciona" in page_text(client, "/admin/accounts/user/", {"action": "delete_selected"})


def test_libraries_still_have_each_text_that_is_retranslated():
    def texts(path: Path) -> dict[object, str]:
        with (path / "LC_MESSAGES" / "django.mo").open("rb") as compiled:
            return dict(gettext.GNUTranslations(compiled)._catalog)

    base = Path(django.__file__).parent
    theirs: dict[object, str] = {}
    for part in ("conf", "contrib/admin", "contrib/auth"):
        theirs |= texts(base / part / "locale" / "es")
    theirs |= texts(Path(allauth.__file__).parent / "locale" / "es")
    ours = texts(settings.BASE_DIR / "locale" / "libraries" / "es")
    assert len(ours) > 80
    assert [key for key in ours if key and key not in theirs] == []
    assert [key for key, text in ours.items() if key and USTED.search(text)] == []
