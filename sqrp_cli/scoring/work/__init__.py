"""How many candidates are computed at once: jobs, processes, clusters and kept results."""
