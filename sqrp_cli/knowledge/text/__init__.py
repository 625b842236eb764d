"""Text files as data: YAML, JSON and XML with the position of every value, units, and usual ranges."""
