"""Skills: what a task may do, how it moves and what must be seen meanwhile."""
