"""Slips at random times in cells that were made by seed: measured delays against predicted ones."""
