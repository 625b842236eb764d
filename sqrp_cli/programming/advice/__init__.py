"""The least change of a cell, or of a motion in it, that meets a wish; knows no files."""
