"""Which solids touch each other, at one position and along a path."""
