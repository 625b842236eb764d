"""Several paths as one: evaluating it takes hardly longer than evaluating one of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.trajectory import Path


def side_by_side(paths: Sequence[Path]) -> Iterator[tuple[NDArray[np.intp], Path]]:
    """For each degree of polynomials: the paths that have it, by index, (b,), and one path of all their joints, b n.

    The paths have the same breaks and n joints each; the joints of the first come first.
    """
    degrees = np.array([path.coefficients.shape[1] for path in paths])
    for degree in sorted(set(degrees.tolist())):
        rows = np.flatnonzero(degrees == degree)
        joints = np.concatenate([paths[row].coefficients for row in rows.tolist()], axis=2)
        yield rows, Path(paths[0].breaks, joints)
