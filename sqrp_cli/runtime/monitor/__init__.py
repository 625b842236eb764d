"""What evidence means for a step: nominal, judgement, alarms, and the check of predictions."""
