"""The studio: a live page of a cell, served on this machine only."""
