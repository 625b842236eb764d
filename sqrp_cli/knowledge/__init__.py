"""Phase 1, knowledge: the files of a cell, read and validated into frozen records."""
