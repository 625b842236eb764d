"""Computing many candidates: jobs, processes, clusters and kept results."""
