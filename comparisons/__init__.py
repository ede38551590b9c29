"""Side by side: virtual robot, protocols, metrics, experiments, reports, command line."""
