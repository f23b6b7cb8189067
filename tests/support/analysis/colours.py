"""How colours look: their lightness, and how far apart they are for those who see fewer of them.

CIE L*a*b* with the white point D65 (CIE 15:2004); simulated vision after Machado, Oliveira and
Fernandes (2009), table 1, at full severity, in linear RGB.
"""

from itertools import combinations, pairwise

import numpy as np

WHITE = np.array([0.95047, 1.0, 1.08883])
XYZ_FROM_RGB = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
SIMULATED = {
    "protan": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deutan": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    "tritan": np.array(
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ]
    ),
}


def linear(colour: str) -> np.ndarray:
    """Return a colour such as `#D55E00` in linear RGB, (3,)."""
    rgb = np.array([int(colour[at : at + 2], 16) / 255.0 for at in (1, 3, 5)])
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    """Return L*, a*, b* of linear RGB."""
    ratio = XYZ_FROM_RGB @ np.clip(rgb, 0.0, 1.0) / WHITE
    f = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


def lightness(colour: str) -> float:
    return float(lab(linear(colour))[0])


def least_step(colours: tuple[str, ...]) -> float:
    """Return the smallest difference in lightness between neighbours."""
    steps = pairwise(colours)
    return min(abs(lightness(a) - lightness(b)) for a, b in steps)


def least_distance(colours: tuple[str, ...], vision: str) -> float:
    """Return the smallest distance in L*a*b* between any two, as a simulated vision has them."""
    seen = [lab(SIMULATED[vision] @ linear(colour)) for colour in colours]
    return min(float(np.linalg.norm(a - b)) for a, b in combinations(seen, 2))
