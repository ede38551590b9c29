"""The paper's experiments on the virtual robot, one file an experiment, each run by ``python -m``."""
