"""``sensorless demo``: everything there is so far, on the virtual VS060."""

from __future__ import annotations

from pathlib import Path

from comparisons.commands.identify import identify_into
from comparisons.output import OutputDirectory

TRAIN_SECONDS, TEST_SECONDS = 120.0, 40.0


def demo(*, out: Path = Path("sensorless-demo"), seed: int = 1) -> None:
    """Identify the virtual VS060 from sinusoidal excitation, without any hardware.

    Args:
        out: directory for the logs, result.json, report.html, the model and the predictions.
        seed: of motion and noise.
    """
    from comparisons.virtual_robot import simulate
    from ident.log_writer import write_log
    from ident.robot import load_robot

    robot = load_robot("vs060")
    with OutputDirectory(out, "demo") as output:
        logs = output.path / "logs"
        logs.mkdir()
        for name, seconds, number in (("train", TRAIN_SECONDS, seed), ("test", TEST_SECONDS, seed + 1)):
            log, _ = simulate(robot, protocol="sinusoid", seconds=seconds, seed=number)
            write_log(log, logs / f"{name}.parquet")
        identify_into(output, "vs060", [str(logs / "train.parquet")], [str(logs / "test.parquet")], {})
    print(f"{out / 'report.html'}")
