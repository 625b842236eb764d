"""Cells that were broken by a known change, and mended by advice."""
