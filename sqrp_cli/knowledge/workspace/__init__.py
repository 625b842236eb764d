"""The workspace file: its format, its records, and how it is read and validated."""
