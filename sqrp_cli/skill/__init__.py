"""Skill files come in; settings, waypoints, primitives, formulas and faults of a skill go out."""
