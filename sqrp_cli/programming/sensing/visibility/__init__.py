"""Which share of a box a camera sees past everything solid, and what hides the rest."""
