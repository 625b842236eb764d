"""Laws of `sqrp place` over shipped and random cells."""
