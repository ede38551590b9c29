"""Log formats, one a file."""
