"""Design of exciting motions: what to let a robot do so that its parameters show."""
