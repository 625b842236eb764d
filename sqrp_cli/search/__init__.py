"""A goal comes in; the least change of a cell or motion, or the fewest cameras that reach it, go out, with a proof."""
