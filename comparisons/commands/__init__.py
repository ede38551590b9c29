"""Commands of ``sensorless``, one file each; ``comparisons.cli.COMMANDS`` lists them."""
