"""The catalogue: one physical cause of current a class, one family a file."""
