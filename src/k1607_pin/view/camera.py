"""Where to stand so that everything is seen."""

import numpy as np

FIELD_OF_VIEW = 32.0
"""deg, vertical."""
AZIMUTH, ELEVATION = np.radians(-58.0), np.radians(18.0)
"""rad: from where one looks. x points to the right and a little at the viewer, z up."""
MARGIN = 1.08
MARGIN_WITH_LEGEND = 1.2
NARROWEST = 1.0
"""The narrowest window, width over height, that everything still fits in."""


def half_height(distance: float) -> float:
    """Half of what is seen from top to bottom, at a distance, in the same unit."""
    return distance * float(np.tan(np.radians(FIELD_OF_VIEW / 2)))


def fit(points: np.ndarray, margin: float = MARGIN) -> tuple[np.ndarray, np.ndarray]:
    """Centre (3,) to look at and eye (3,) to look from [m], so that all points (N, 3) are in the picture."""
    ca, sa, ce, se = np.cos(AZIMUTH), np.sin(AZIMUTH), np.cos(ELEVATION), np.sin(ELEVATION)
    axes = np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])  # right, up, towards the viewer
    seen = points @ axes.T  # (N, 3)
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    across, up, near = np.abs(seen - middle)[:, 0], np.abs(seen - middle)[:, 1], (seen - middle)[:, 2]
    distance = float(np.max(near + margin * np.maximum(across / NARROWEST, up) / half_height(1.0)))
    centre = middle @ axes
    return centre, centre + max(distance, 0.1) * axes[2]
