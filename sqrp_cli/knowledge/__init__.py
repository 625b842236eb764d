"""Phase 1, knowledge: reading and validating what is known of a cell, into frozen records."""
