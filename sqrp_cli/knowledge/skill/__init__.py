"""Skills: their preconditions and effects, their motions, and what must be seen during them."""
