"""The workspace file: its format, what it describes, and how that is read and validated."""
