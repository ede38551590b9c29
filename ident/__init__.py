"""The robot, its logs, the physics, identification and the gap workflow."""
