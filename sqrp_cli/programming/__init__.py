"""Phase 2, programming: from a task to ranked candidates and a program."""
