"""Many workspaces and tasks at once: thresholds, baselines, sweeps; on one machine or a cluster."""
