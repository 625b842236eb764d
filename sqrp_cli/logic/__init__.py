"""Predicates, literals, planning and Metric Temporal Logic; independent of robots."""
