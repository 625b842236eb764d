"""Pages and pictures of what was computed."""
