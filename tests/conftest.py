"""What several test files share: where the robots and the measured logs are, and cards of robots made for a test."""

from collections.abc import Callable
from importlib.metadata import files
from pathlib import Path

import numpy as np
import pytest

from ident.robot import Robot, load_robot

MEASURED = Path(__file__).parents[2] / "shared" / "data"

# robots of the example-robot-data wheel, by the names the tests use
EXAMPLES = {
    "ur3": "ur_description/urdf/ur3_robot.urdf",
    "ur3-nameless": "ur_description/urdf/ur3.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "ur10": "ur_description/urdf/ur10_robot.urdf",
    "panda": "panda_description/urdf/panda.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
}
ARM_JOINTS = {"panda": [f"panda_joint{i}" for i in range(1, 8)]}  # without the fingers


@pytest.fixture(scope="session")
def urdf_path() -> Callable[[str], Path]:
    """Path of a robot's URDF: ur3, ur5, ur10, panda, xarm7, vs060, lwr4; the test is skipped where it is not there."""

    def find(name: str) -> Path:
        if name == "vs060":
            return Path(__file__).parents[1] / "ident" / "robots" / "vs060" / "vs060.urdf"
        if name == "lwr4":
            return _present(MEASURED / "kuka_lwr4_flobaroid" / "kuka_lwr4.urdf")
        wanted = f"example-robot-data/robots/{EXAMPLES[name]}"
        found = [f for f in files("example-robot-data") or [] if str(f).endswith(wanted)]
        return _present(Path(str(found[0].locate())) if found else Path(wanted))

    return find


@pytest.fixture(scope="session")
def arm_joints() -> Callable[[str], list[str] | None]:
    """Joints of a robot's arm, None for all that move."""
    return ARM_JOINTS.get


@pytest.fixture(scope="session")
def measured() -> Callable[[str], Path]:
    """Path of a measured log under shared/data; the test is skipped where it is not there."""
    return lambda name: _present(MEASURED / name)


@pytest.fixture(scope="session")
def vs060() -> Robot:
    """The built-in robot."""
    return load_robot("vs060")


@pytest.fixture(scope="session")
def write_card(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Write a robot's URDF and a card that names it into a new folder, ``lines`` below; the path of the card."""

    def write(name: str, urdf: str, *lines: str) -> Path:
        card = tmp_path_factory.mktemp(name) / "robot.toml"
        card.with_name(f"{name}.urdf").write_text(urdf)
        card.write_text("\n".join([f'name = "{name}"', f'urdf = "{name}.urdf"', *lines, ""]))
        return card

    return write


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator of the same numbers for every test."""
    return np.random.default_rng(7)


def _present(path: Path) -> Path:
    if not path.exists():
        pytest.skip(f"{path.name} is not here")
    return path
