"""Many workspaces and tasks come in; scores, baselines and sweeps go out, from one machine or a cluster."""
