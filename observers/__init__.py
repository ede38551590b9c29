"""From model and measurement to residual, contact, wrench and compliance."""
