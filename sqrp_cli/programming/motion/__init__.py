"""Motion planning for a skill: fast, within the limits, free of collisions."""
