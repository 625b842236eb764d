"""What scores are held against: thresholds, baselines and other cells."""
