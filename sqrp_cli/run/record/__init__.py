"""What a run leaves behind: its events, its log, its report, its images."""
