"""The simulated cell as a process of its own, reached by messages alone."""
