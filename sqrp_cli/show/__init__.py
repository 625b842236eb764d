"""Documents come in; tables, pages and pictures go out."""
