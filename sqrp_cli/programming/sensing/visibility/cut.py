"""Boxes that the image's edge cuts, for detectors that judge what it leaves of them."""

from __future__ import annotations

import numpy as np

from sqrp_cli.geometry import Array, Indices, begins_run, inverse, transform
from sqrp_cli.programming.sensing.limits import cut_by_image
from sqrp_cli.programming.sensing.sight_lines import Pairs, SightLines, WatchedBoxes
from sqrp_cli.programming.sensing.visibility.visible_share import VisibleShares, count_rays, rays_around


def cut_shares(watched: WatchedBoxes, lines: SightLines, camera: Indices) -> Array:
    """The share of the box of each sight line that the image's edge cuts, 0 where it must not cut any, shape (v,).

    camera: of each line, by index, shape (v,).
    """
    judged = np.array([entry.limits.judges_rest for entry in watched.boxes])[lines.box]
    eye, found = camera[begins_run(lines.hull)], np.zeros(len(lines.box))
    for number in np.unique(eye[judged]).tolist():
        some = judged & (eye == number)
        corners_C = transform(inverse(lines.X_WC[some]), lines.corners[some]).transpose(2, 1, 0)
        found[some] = cut_by_image(watched.projections[number], corners_C)
    return found[lines.hull]


def shares_within(watched: WatchedBoxes, lines: SightLines, pairs: Pairs, camera: Indices) -> VisibleShares:
    """The shares of the boxes of the sight lines in the pairs that are visible and within the image.

    pairs: as in `visible_shares`. camera: of each line, by index, shape (v,).
    """
    line, share = [np.empty(0, dtype=np.int64)], [np.empty(0)]
    for around in rays_around(lines, watched.solid_poses, pairs, np.zeros(len(lines.box))):
        rays, hull = around.rays, lines.hull[around.line]
        directions_C = around.view.directions[:, rays.hull] @ lines.X_WC[hull, :3, :3]
        free = rays.silhouette & ~rays.blocked
        for number in np.unique(camera[around.line]).tolist():
            own = camera[around.line] == number
            free[:, own] &= watched.projections[number].shows(directions_C[:, own])
        line.append(around.line)
        share.append(count_rays(free) / np.maximum(count_rays(rays.silhouette), 1.0))
    return VisibleShares(np.concatenate(line), np.concatenate(share))
