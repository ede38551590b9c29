"""What a robot card may hold: the tables of ``robot.toml`` as pydantic models."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from ident.multibody import EARTH_GRAVITY


def _not_nan(value: float) -> float:
    if np.isnan(value):
        raise ValueError("is not a number")
    return value


Name = Annotated[str, Field(min_length=1)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Bound = Annotated[float, AfterValidator(_not_nan)]
PositiveBound = Annotated[float, Field(gt=0)]
Columns = Annotated[list[Name], Field(min_length=1)] | Name
Scale = Finite | list[Finite]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Drive(_Table):
    """What is known of the drives, one value a joint: ``[drive]``."""

    gain: list[Positive] | None = None
    gear_ratio: list[Positive] | None = None
    coupling: list[list[Finite]] | None = None


class Limits(_Table):
    """Joint limits that override the URDF's, one value a joint: ``[limits]``."""

    lower: list[Bound] | None = None
    upper: list[Bound] | None = None
    velocity: list[PositiveBound] | None = None
    acceleration: list[PositiveBound] | None = None
    effort: list[PositiveBound] | None = None


class Scales(_Table):
    """Factors from a foreign log's numbers to the units of the contract, one or one a column; a sign is a factor."""

    time: Finite = 1.0
    position: Scale = 1.0
    current: Scale = 1.0
    velocity: Scale = 1.0
    acceleration: Scale = 1.0
    tau_ext: Scale = 1.0
    wrench: Scale = 1.0
    temperature: Scale = 1.0


class LogMapping(_Table):
    """How to read a foreign log: ``[log]``.

    Each quantity is a list of column or signal names, one a joint (``wrench``: six), or the one name of an (N, n)
    array, as ``.npz`` and ``.mat`` hold them.
    """

    time: Name
    position: Columns
    current: Columns
    velocity: Columns | None = None
    acceleration: Columns | None = None
    tau_ext: Columns | None = None
    wrench: Columns | None = None
    temperature: Columns | None = None
    segment: Name | None = None
    scale: Scales = Scales()


class RobotCard(_Table):
    """A robot card (``robot.toml``) as the contract describes it."""

    name: Name
    urdf: Name
    joints: Annotated[list[Name], Field(min_length=1)] | None = None
    current_unit: Name = "A"
    gravity: Annotated[list[Finite], Field(min_length=3, max_length=3)] = list(EARTH_GRAVITY)
    drive: Drive = Drive()
    limits: Limits = Limits()
    log: LogMapping | None = None
