"""What the processes of a run import: those that look at images, and those that draw them in simulation."""

from __future__ import annotations

NEEDED = ("cv2", "sqrp_cli.runtime.perception.image_detector", "sqrp_cli.runtime.cell.render_pool")
"""For `platform.processes.fresh`. MuJoCo is not among it: what it opens to draw must not be shared."""
