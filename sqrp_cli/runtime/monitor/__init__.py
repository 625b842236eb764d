"""What evidence means for a step: expectation, judgement, alarms, and the check of predictions."""
