"""The visible share of a box past all solids, and what hides the rest."""
