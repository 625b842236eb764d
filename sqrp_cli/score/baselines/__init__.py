"""What scores are compared with: thresholds, baselines and other cells."""
