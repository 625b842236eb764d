"""How the arm moves through a skill: fast, within its limits, clear of everything it may not touch."""
