"""When a detector of colours calls a part held, gone or in a place: shared by the detector and by what predicts it."""

from __future__ import annotations

LEAST_SHARE, MOST_SHARE = 0.35, 0.5
"""Share of the silhouette of a coloured object that must be judged, at least and at most; in between, what its
detector requires to be visible. Of an object that nothing hides, a good part may still look like neither it nor the
background: at its edges, and where it meets the robot."""

FULL, EMPTY = 0.6, 0.1
"""A box is filled if it shows at least this share of the colour that its object would show, empty if at most this.
An object that is not held counts as in a place that is filled by more than half of the former."""

SHIFT_PIXELS, SHIFT_SHARE = 2.0, 0.05
"""How far the patch of an object may lie from where the tool would show it: pixels, plus a share of its size there."""

ALIKE = 0.02
"""Places explain an image equally well if they differ by no more than this share of the part's silhouette; the nearest
to where the tool would show it counts."""
