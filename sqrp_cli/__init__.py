"""SQRP computes how well the cameras of a robot cell will see what matters, before the robot moves."""

from sqrp_cli.api.cell import OpenCell as OpenCell
from sqrp_cli.api.cell import open_cell as open_cell
from sqrp_cli.version import __version__ as __version__
