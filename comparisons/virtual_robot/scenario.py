"""The scenario file: which effects the virtual robot has, and how strong each of them is in each joint."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from comparisons.virtual_robot.tables import (
    Backlash,
    BaseTilt,
    CableSpring,
    Cogging,
    CoulombAsymmetry,
    CrossJointFriction,
    CrossJointHysteresis,
    CurrentOffset,
    Delay,
    DriveGain,
    Elasticity,
    FilterLag,
    Friction,
    GearRipple,
    GravityBalancer,
    Links,
    LoadFriction,
    Motors,
    Payload,
    PositionFriction,
    Section,
    SensorDrift,
    SensorNoise,
    Servo,
    ThermalFriction,
    TorqueSaturation,
    ViscousNonlinear,
)
from ident.errors import InputError

SCENARIOS = Path(__file__).parent / "scenarios"


class Scenario(Section):
    """What is true of a virtual robot; a table left out is an effect that is not there."""

    name: str = "scenario"
    links: Links = Links()
    motors: Motors = Motors()
    servo: Servo = Servo()
    friction: Friction | None = None
    load_friction: LoadFriction | None = None
    coulomb_asymmetry: CoulombAsymmetry | None = None
    position_friction: PositionFriction | None = None
    viscous_nonlinear: ViscousNonlinear | None = None
    cross_joint_hysteresis: CrossJointHysteresis | None = None
    thermal_friction: ThermalFriction | None = None
    cross_joint_friction: CrossJointFriction | None = None
    elasticity: Elasticity | None = None
    backlash: Backlash | None = None
    gear_ripple: GearRipple | None = None
    cogging: Cogging | None = None
    cable_spring: CableSpring | None = None
    gravity_balancer: GravityBalancer | None = None
    torque_saturation: TorqueSaturation | None = None
    drive_gain: DriveGain | None = None
    current_offset: CurrentOffset | None = None
    sensor_drift: SensorDrift | None = None
    delay: Delay | None = None
    filter_lag: FilterLag | None = None
    payload: Payload | None = None
    base_tilt: BaseTilt | None = None
    sensors: SensorNoise | None = None

    def with_effect(self, effect: str, **figures: Any) -> Scenario:
        """Return the scenario with one effect added or replaced, named as in the contract (``gear-ripple``).

        Raises:
            InputError: no such effect, or a figure it does not have.
        """
        key = effect.replace("-", "_")
        return _validated({**self.model_dump(exclude_none=True), key: figures}, f"scenario {self.name}")

    def without(self, *effects: str) -> Scenario:
        """Return the scenario with some effects taken out.

        Raises:
            InputError: an effect's name is unknown.
        """
        tables = self.model_dump(exclude_none=True)
        for effect in effects:
            key = effect.replace("-", "_")
            if key not in Scenario.model_fields:
                raise InputError(f"no effect {effect!r}", f"scenario {self.name}", "name one of the contract's effects")
            tables.pop(key, None)
        return _validated(tables, f"scenario {self.name}")


def _validated(tables: dict[str, Any], where: str) -> Scenario:
    try:
        return Scenario.model_validate(tables)
    except ValidationError as error:
        detail = error.errors()[0]
        key = ".".join(str(part) for part in detail["loc"][:2])
        what = f"unknown key {key!r}" if detail["type"] == "extra_forbidden" else f"{key}: {detail['msg']}"
        raise InputError(what, where, "see comparisons/virtual_robot/tables.py for what each table holds") from error


def built_in_scenarios() -> list[str]:
    """Names of the scenarios that need no path."""
    return sorted(path.stem for path in SCENARIOS.glob("*.toml"))


def load_scenario(scenario: str | Path) -> Scenario:
    """Load a scenario by built-in name (``vs060``, ``generic``, ``quiet``) or by the path of a TOML file.

    Args:
        scenario: name or path.

    Raises:
        InputError: no such scenario, or a file that does not hold one.
    """
    built_in = isinstance(scenario, str) and scenario in built_in_scenarios()
    path = SCENARIOS / f"{scenario}.toml" if built_in else Path(scenario)
    if not path.is_file():
        names = ", ".join(built_in_scenarios())
        raise InputError(f"no scenario {str(scenario)!r}", "scenario", f"give a TOML file or a built-in name: {names}")
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeError) as error:
        raise InputError(f"not valid TOML ({error})", f"scenario {path}", "mend that line") from error
    return _validated({"name": path.stem, **tables}, f"scenario {path}")
