"""Distance of an arm from itself and its surroundings, along whole paths and not only at samples of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from ident.arrays import FloatArray, IntArray
from ident.excitation.fourier import Trajectory
from ident.excitation.geometry import ArmGeometry, Body, Surroundings
from ident.multibody import Multibody

POSES = 400  # random poses that show which pairs can never come apart
ALWAYS = 0.95  # share of them above which a pair counts as built that way
CLOSE_SHARE = 0.5  # of its largest distance that a pair keeps which is built too close for the clearance
LARGEST = 0.95  # quantile of its distances over random poses that counts as a pair's largest
STEADY = 0.005  # [m] by which the distance of a link from a plane may vary that it does not move towards
SEED = 0
FINEST = 2.0**-14  # share of the period below which an undecided piece of path counts as too close
FIRST_PIECES = 64


@dataclass(frozen=True)
class Closest:
    """Where a path has least to spare.

    Attributes:
        kept: whether every pair keeps the distance it is to keep, at all times.
        least: distance [m] of the pair that has least to spare among the poses examined.
        pair: what it is between.
        time: when [s].
    """

    kept: bool
    least: float
    pair: str
    time: float


@dataclass(frozen=True, eq=False)
class ClearanceModel:
    """Distances between all pairs of bodies that can come to touch.

    Attributes:
        multibody: the arm.
        geometry: its bodies.
        surroundings: ground, walls and the clearance to keep.
        model, data: Pinocchio's geometry with planes and pairs.
        pairs: indices of each pair in the model; planes stand after the bodies, (P, 2).
        reach: greatest speed [m/s, per rad/s or m/s] with which each joint can bring each pair together, (P, n).
        wanted: distance that each pair is to keep [m], (P,): the clearance, or half of the pair's largest distance over
            random poses where that is less, for links that are built close to each other.
        never_apart: pairs left out since they are closer than even that in almost every pose.
    """

    multibody: Multibody
    geometry: ArmGeometry
    surroundings: Surroundings
    model: Any
    data: Any
    pairs: IntArray
    reach: FloatArray
    wanted: FloatArray
    never_apart: tuple[str, ...]

    @staticmethod
    def build(
        multibody: Multibody, geometry: ArmGeometry, surroundings: Surroundings, span: FloatArray
    ) -> ClearanceModel:
        """Collect the pairs; ``span`` (2, n) are the positions among which poses are drawn.

        Pairs on one link or on neighbouring ones are left out, and those that are close in almost every pose, unless
        one of them is a plane towards which the other moves.
        """
        model, planes = geometry.with_planes(surroundings.planes())
        pairs = _pairs(multibody, geometry, planes)
        reach = np.array([_reach(multibody, geometry, pair, span) for pair in pairs]).reshape(-1, multibody.n)
        full = _assemble(multibody, geometry, surroundings, model, pairs, reach, np.zeros(len(pairs)), ())
        q = np.random.default_rng(SEED).uniform(span[0], span[1], (POSES, multibody.n))
        distances = np.array([full.distances(pose) for pose in q])
        # A link that can leave the ground or a wall has to, however rarely a random pose does.
        moving = (pairs[:, 1] >= len(geometry.bodies)) & (np.ptp(distances, axis=0) > STEADY)
        largest = np.maximum(np.quantile(distances, LARGEST, axis=0), 0.0)
        wanted = np.minimum(surroundings.clearance, np.where(moving, np.inf, CLOSE_SHARE * largest))
        close = (np.mean(distances <= wanted, axis=0) > ALWAYS) & ~moving
        names = tuple(dict.fromkeys(full.name(int(p)) for p in np.flatnonzero(close)))
        return _assemble(multibody, geometry, surroundings, model, pairs[~close], reach[~close], wanted[~close], names)

    def distances(self, q: FloatArray) -> FloatArray:
        """Signed distance [m] of every pair at a pose q (n,), (P,)."""
        ordered = np.empty(self.multibody.n)
        ordered[self.multibody.model_index] = q
        pin.updateGeometryPlacements(self.multibody.model, self.multibody.data, self.model, self.data, ordered)
        pin.computeDistances(self.model, self.data)
        return np.array([result.min_distance for result in self.data.distanceResults])

    def name(self, pair: int) -> str:
        """Return what a pair is, ``link a and link b``."""
        a, b = (self.model.geometryObjects[int(k)].name.rsplit("_", 1) for k in self.pairs[pair])
        return f"{a[0]} and {b[0]}"

    def watched(self) -> bool:
        """Tell whether there is anything that could touch."""
        return len(self.pairs) > 0

    def built_close(self) -> tuple[str, ...]:
        """Pairs that keep less than the clearance since they are built close to each other."""
        close = np.flatnonzero(self.wanted < self.surroundings.clearance)
        return tuple(dict.fromkeys(self.name(int(p)) for p in close))

    def touching(self, q: FloatArray, ease: float = 0.0) -> str:
        """Name the pair that is most too close at a pose, empty where none is.

        ``ease`` [m] is kept beyond, by pairs built close in proportion to what they keep.
        """
        if not self.watched():
            return ""
        share = self.wanted / max(self.surroundings.clearance, 1e-9)
        spare = self.distances(q) - self.wanted - ease * np.minimum(share, 1.0)
        nearest = int(np.argmin(spare))
        return self.name(nearest) if spare[nearest] < 0 else ""

    def along(self, trajectory: Trajectory, stop: bool = True) -> Closest:
        """Examine a whole path: between the poses looked at, no pair can come closer than its joints move it.

        Pieces of the path are halved until the distances at their middle exceed what the joints can cover in half of
        the piece, or fall short of the clearance. ``stop`` ends the search at the first pose that is too close.
        """
        if not self.watched():
            return Closest(True, np.inf, "", 0.0)
        kept, least, pair, time = True, np.inf, 0, 0.0
        pieces: FloatArray = (np.arange(float(FIRST_PIECES)) + 0.5) * (trajectory.family.period / FIRST_PIECES)
        half = 0.5 * trajectory.family.period / FIRST_PIECES
        surge = trajectory.bound(2)
        while len(pieces):
            motion = trajectory.at(pieces)
            undecided = np.zeros(len(pieces), dtype=np.bool_)
            for k, (q, dq) in enumerate(zip(motion.q, motion.dq, strict=True)):
                distance = self.distances(q)
                spare = distance - self.wanted
                nearest = int(np.argmin(spare))
                if spare[nearest] < least:
                    least, pair, time = float(spare[nearest]), nearest, float(pieces[k])
                if spare[nearest] < 0:
                    kept = False
                    if stop:
                        return Closest(kept, least + float(self.wanted[pair]), self.name(pair), time)
                    continue
                travel = self.reach @ (np.abs(dq) + 0.5 * surge * half) * half
                undecided[k] = bool(np.any(spare < travel))
            half *= 0.5
            pieces = np.concatenate([pieces[undecided] - half, pieces[undecided] + half])
            if half < FINEST * trajectory.family.period and len(pieces):
                kept = False
                break
        return Closest(kept, least + float(self.wanted[pair]), self.name(pair), time)


def _assemble(
    multibody: Multibody,
    geometry: ArmGeometry,
    surroundings: Surroundings,
    model: Any,
    pairs: IntArray,
    reach: FloatArray,
    wanted: FloatArray,
    never_apart: tuple[str, ...],
) -> ClearanceModel:
    watched = model.copy()
    for a, b in pairs:
        watched.addCollisionPair(pin.CollisionPair(int(a), int(b)))
    data = watched.createData()
    return ClearanceModel(multibody, geometry, surroundings, watched, data, pairs, reach, wanted, never_apart)


def _pairs(multibody: Multibody, geometry: ArmGeometry, planes: IntArray) -> IntArray:
    """Bodies on links that are neither the same nor neighbours, and moving bodies with every plane."""
    parent, joints = multibody.tree.parent, [body.joint for body in geometry.bodies]
    bearing = set(joints)

    def before(k: int) -> int:
        """Return the nearest link towards the base that has a body: those without one part no neighbours."""
        k = int(parent[k])
        while k >= 0 and k not in bearing:
            k = int(parent[k])
        return k

    found = []
    for a, i in enumerate(joints):
        for b, k in enumerate(joints[:a]):
            if i != k and (i < 0 or before(i) != k) and (k < 0 or before(k) != i):
                found.append((b, a))
        if i >= 0:
            found += [(a, int(plane)) for plane in planes]
    return np.array(found, dtype=np.int64).reshape(-1, 2)


def _reach(multibody: Multibody, geometry: ArmGeometry, pair: IntArray, span: FloatArray) -> FloatArray:
    """Greatest relative speed of two bodies' points per speed of each joint, (n,)."""
    speed = np.zeros(multibody.n)
    chains = []
    for k in pair:
        plane = k >= len(geometry.bodies)
        chains.append({} if plane else _levers(multibody, geometry.bodies[int(k)], span))
    for a, b in (chains, chains[::-1]):
        for joint, lever in a.items():
            if joint not in b:  # a joint that carries both bodies does not bring them together
                speed[joint] = lever
    return speed


def _levers(multibody: Multibody, body: Body, span: FloatArray) -> dict[int, float]:
    """Farthest that a body's points can be from each joint's origin below it [m]; 1 for a joint that slides."""
    tree, levers, distance = multibody.tree, {}, body.radius
    k = body.joint
    while k >= 0:
        slide = float(np.abs(span[:, k]).max()) if tree.prismatic[k] else 0.0
        levers[k] = 1.0 if tree.prismatic[k] else distance
        distance += float(np.linalg.norm(tree.translation[k])) + slide
        k = int(tree.parent[k])
    return levers
