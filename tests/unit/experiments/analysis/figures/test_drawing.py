"""Figures for print: files that can be edited, and colours that differ in a grey print and for
colour-blind readers.
"""

import io
import re
import zlib
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from PIL import Image

from experiments.analysis.figures.drawing import (
    DASHES,
    MARKERS,
    NEGATIVE,
    POSITIVE,
    ROBOTS,
    as_pdf,
    as_png,
    as_svg,
)
from experiments.analysis.figures.opinions import figure_8a, figure_8b
from experiments.analysis.figures.scores import score_figures
from experiments.analysis.figures.trajectories import figure_6
from tests.support.analysis.colours import SIMULATED, least_distance, least_step, lightness
from tests.support.analysis.study_dataset import made_up

PALETTES = {"robots": ROBOTS, "sides": (NEGATIVE, POSITIVE)}
# In L*a*b*, 2.3 is the least difference that is noticed side by side (Mahy et al., 1994); across a
# figure it takes several times that.
GREY, APART = 14.0, 15.0
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def dataset():
    return made_up(np.random.default_rng(51), 8)


@pytest.mark.parametrize("name", PALETTES)
def test_neighbours_differ_in_a_grey_print(name):
    assert least_step(PALETTES[name]) > GREY


@pytest.mark.parametrize("vision", SIMULATED)
@pytest.mark.parametrize("name", PALETTES)
def test_no_two_colours_look_the_same_to_those_who_see_fewer(name, vision):
    assert least_distance(PALETTES[name], vision) > APART


def test_the_measures_find_a_palette_that_fails():
    assert least_step(("#d62728", "#1b9e4b")) < GREY
    assert least_distance(("#a0522d", "#6b6b23"), "deutan") < APART
    assert lightness("#000000") == pytest.approx(0.0, abs=0.01)
    assert lightness("#ffffff") == pytest.approx(100.0, abs=0.01)


def test_each_robot_has_a_marker_and_a_line_of_its_own():
    assert len(set(MARKERS)) == len(set(DASHES)) == len(set(ROBOTS)) == 6


def test_the_text_of_an_svg_is_text(dataset):
    root = ET.fromstring(as_svg(figure_8a(dataset)))
    texts = [text.text for text in root.iter(f"{SVG}text")]
    assert "Carrying out the task was not stressful. (Q4)" in texts
    assert all("sans-serif" in text.get("style") for text in root.iter(f"{SVG}text"))


@pytest.mark.slow
def test_a_pdf_has_its_fonts_in_it_as_truetype(dataset):
    pdf = as_pdf(figure_8a(dataset))
    assert re.search(rb"/FontFile2 \d+ 0 R", pdf)
    assert b"/Type3" not in pdf
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", pdf, re.DOTALL)
    # The last byte of a sum may look like an end of line, and is then not in the stream.
    unpacked = [zlib.decompressobj().decompress(one) for one in streams if one[:1] == b"\x78"]
    assert any(one[:4] in {b"\x00\x01\x00\x00", b"true"} for one in unpacked)


@pytest.mark.slow
def test_a_png_has_the_dots_that_print_needs_and_no_date(dataset):
    drawing = figure_8b(dataset)
    png = as_png(drawing)
    image = Image.open(io.BytesIO(png))
    assert image.info["dpi"] == pytest.approx((600, 600), abs=0.1)
    assert image.width == pytest.approx(7.0 * 600, abs=2)
    assert set(image.info) == {"Title", "dpi"}


@pytest.mark.slow
def test_files_are_the_same_bytes_every_time(dataset):
    first, second = figure_8b(dataset), figure_8b(dataset)
    for save in (as_svg, as_pdf, lambda drawing: as_png(drawing, 50)):
        assert save(first) == save(second)


def test_a_map_has_a_scale_bar_of_a_round_length(dataset):
    drawing = figure_6(dataset, "office")
    (axes,) = drawing.figure.axes
    (bar,) = [line for line in axes.lines if line.get_gid() == "scale-bar"]
    left, right = bar.get_xdata()
    assert right - left == pytest.approx(2.0)
    assert "2 m" in {text.get_text() for text in axes.texts}


def test_error_bars_lie_inside_the_axes_and_are_explained_in_a_note(dataset):
    (drawing, *_) = score_figures(dataset)
    assert any("bars their 95 % confidence intervals" in note for note in drawing.numbers.notes)
    for axes in drawing.figure.axes:
        low, high = axes.get_xlim()
        for line in axes.lines:
            assert low <= min(line.get_xdata()) <= max(line.get_xdata()) <= high
