"""Identifiers of people and datasets: typing errors are found before a repository finds them."""

import pytest

from experiments.definition.publication import (
    is_address,
    is_doi,
    is_orcid,
    plain_doi,
    plain_orcid,
)


# The examples are those of ORCID's own documentation, and of Zenodo's.
@pytest.mark.parametrize(
    "orcid", ["0000-0002-1825-0097", "0000-0001-5109-3700", "0000-0002-1694-233X"]
)
def test_an_orcid_with_its_right_check_digit_is_one(orcid):
    assert is_orcid(orcid)
    assert is_orcid(plain_orcid(f" https://orcid.org/{orcid} "))


@pytest.mark.parametrize("digit", "012345678X")
def test_no_other_last_character_will_do(digit):
    assert not is_orcid(f"0000-0001-5109-370{digit}") or digit == "0"


@pytest.mark.parametrize(
    "text",
    ["", "0000000218250097", "0000-0002-1825-097", "0000-0002-1694-233x", "٠٠٠٠-0002-1825-0097"],
)
def test_malformed_orcid_is_refused(text):
    assert not is_orcid(text)


def test_two_digits_that_changed_places_are_found():
    assert not is_orcid("0000-0002-8125-0097")


@pytest.mark.parametrize(
    ("text", "doi"),
    [
        ("10.5281/zenodo.1234567", "10.5281/zenodo.1234567"),
        ("https://doi.org/10.17605/OSF.IO/ABCDE", "10.17605/OSF.IO/ABCDE"),
        ("http://dx.doi.org/10.1000/182", "10.1000/182"),
        ("doi: 10.1000/182", "10.1000/182"),
    ],
)
def test_a_doi_may_be_written_as_an_address(text, doi):
    assert plain_doi(text) == doi
    assert is_doi(doi)


@pytest.mark.parametrize("text", ["", "zenodo.1234567", "10.5281", "10.5281/a b", "11.5281/a"])
def test_malformed_doi_is_refused(text):
    assert not is_doi(text)


def test_an_address_has_a_scheme_that_a_browser_opens():
    assert is_address("https://osf.io/abcde")
    assert not is_address("osf.io/abcde")
    assert not is_address("javascript:alert(1)")
