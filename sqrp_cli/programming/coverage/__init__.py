"""Coverage of a whole motion: sampled states, timelines, qualities, faults and verdicts."""
