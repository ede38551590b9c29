"""Networks that predict motor current, with memory of motion."""
