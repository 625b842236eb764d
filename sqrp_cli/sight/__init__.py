"""Sight: the compiled kernel of what cameras see of boxes, and its boundary."""
