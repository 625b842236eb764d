"""Text comes in; values with the place of each, units and limits go out: YAML, JSON, XML, packages, and edits."""
