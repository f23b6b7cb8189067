"""Classes that are found by name."""

import itertools

import pytest

from surveys.registry import family

COUNT = itertools.count()


class Base:
    """What the modules of a family have one subclass of."""


@pytest.fixture
def found(tmp_path, monkeypatch):
    """Return the family of a package with these modules."""

    def found(**modules: str) -> dict[str, type[Base]]:
        package = f"family_for_tests_{next(COUNT)}"
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text("")
        for name, text in modules.items():
            source = f"from {__name__} import Base\n{text}"
            (tmp_path / package / f"{name}.py").write_text(source)
        monkeypatch.syspath_prepend(str(tmp_path))
        return family(package, [str(tmp_path / package)], Base)

    return found


def test_each_module_brings_its_class_in_alphabetical_order(found):
    classes = found(b="class One(Base): pass", a="class Two(Base): pass")
    assert [(name, one.__name__) for name, one in classes.items()] == [("a", "Two"), ("b", "One")]


@pytest.mark.parametrize("text", ["", "class One(Base): pass\nclass Two(Base): pass"])
def test_a_module_without_exactly_one_class_is_an_error(found, text):
    with pytest.raises(TypeError, match="a needs one subclass of Base"):
        found(a=text)
