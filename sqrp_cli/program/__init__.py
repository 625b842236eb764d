"""Robot programs: what one holds, its file, checks of an edited one and what other tools read."""
