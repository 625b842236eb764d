"""What SQRP finds in its input: the registry of all findings."""
