"""Predicates, literals and Metric Temporal Logic; nothing in here knows about robots."""
