"""What evidence means for a step: the nominal step, verdicts, alarms, and the check of predictions."""
