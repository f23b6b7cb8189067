from importlib.util import find_spec

import pytest

from benchmarks.__main__ import BENCHMARKS, module_of


@pytest.mark.parametrize("name", BENCHMARKS)
def test_every_benchmark_is_found_by_the_name_of_its_file(name):
    assert find_spec(module_of(name)) is not None


def test_a_benchmark_is_found_inside_of_a_folder():
    assert module_of("docking") == "benchmarks.driving.docking"


def test_an_unknown_benchmark_says_so():
    with pytest.raises(SystemExit, match="no benchmark gliding"):
        module_of("gliding")
