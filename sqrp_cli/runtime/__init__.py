"""Phase 3: run a program, monitor it through cameras, and react to what they show."""
