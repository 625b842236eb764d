"""A candidate and its motion come in; samples, figures, faults, verdicts and a ranking go out."""
