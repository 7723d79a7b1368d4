"""One palette by meaning, told apart by persons with any colour vision, on white and on dark, and used everywhere."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest

from ema.plot import palette

ROOT = Path(__file__).parents[2]
DARK = "#12161d"  # ground of the page in the dark
# How linear RGB is seen (Machado, Oliveira and Fernandes 2009, severity 1).
VISION = {
    "usual": np.eye(3),
    "without green": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "without red": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "without blue": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def linear(colour):
    value = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def lab(rgb):
    x = XYZ @ np.clip(rgb, 0.0, 1.0) / [0.9505, 1.0, 1.089]
    f = np.where(x > 0.008856, np.cbrt(x), 7.787 * x + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def contrast(one, other):
    low, high = sorted(XYZ[1] @ linear(each) for each in (one, other))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("seen", VISION)
def test_colours_of_two_meanings_differ_for_every_colour_vision(seen):
    colours = [lab(np.asarray(VISION[seen]) @ linear(one)) for one in palette.BY_MEANING]
    least = min(np.linalg.norm(a - b) for a, b in itertools.combinations(colours, 2))
    assert least > 24.0  # about ten times what can just be told apart


@pytest.mark.parametrize("colour", palette.BY_MEANING)
def test_every_colour_is_seen_on_white_and_on_dark(colour):
    assert contrast(colour, "#ffffff") >= 3.0  # WCAG 2.2, 1.4.11
    assert contrast(colour, DARK) >= 3.0


def test_shades_of_one_meaning_differ_in_grey():
    lightness = [lab(linear(one))[0] for one in (palette.USED, palette.LEFT_OUT, palette.ELSEWHERE)]
    assert (np.diff(lightness) > 12.0).all()


def test_no_figure_has_a_colour_of_its_own():
    elsewhere = {"ema/plot/palette.py", "updating/diagnosis/signature.py"}
    one = re.compile(r"\"#[0-9a-fA-F]{6}\"|colou?r=\"(?!white|none|primary|error)|cmap=\"|\"colorscale\": \"")
    found = [
        f"{file.relative_to(ROOT).as_posix()}: {line.strip()}"
        for package in ("ema", "updating", "docs")
        for file in sorted((ROOT / package).rglob("*.py"))
        if file.relative_to(ROOT).as_posix() not in elsewhere
        for line in file.read_text(encoding="utf-8").splitlines()
        if one.search(line)
    ]
    assert found == []
