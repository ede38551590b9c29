"""Logs in which an effect is hidden, and how often the gap workflow, and what people do today, find it."""
