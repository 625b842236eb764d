"""Phase 3: run a program, watch it through cameras, and act on what they show."""
