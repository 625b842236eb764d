"""A candidate's waypoints come in; a timed motion free of collisions goes out, or why there is none."""
