"""Articulated people: proportions, clothes, poses and gait.

A body is made of lofts and tubes along the bones: hips, torso, neck, head, arms, hands, legs and
feet, and what is worn or carried. Its frame: origin on the floor under the neck, x where the body
faces, y to its left, z up; the neck's axis is x = y = 0 in every pose, so the place of a person is
exactly the place of the frame. When a person leans (`Person.lean`), the neck is ahead of the frame
by half of that and the hips are behind it by the other half. Proportions follow Winter,
Biomechanics and Motor Control of Human Movement (segment lengths over stature).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrs_people_sim.models import textures
from mrs_people_sim.models.meshes import Mesh, box, ellipsoid, loft, merge, tube
from mrs_people_sim.models.textures import Atlas
from mrs_people_sim.motion import Place
from mrs_people_sim.scene import Person

_X, _Y, _Z = np.eye(3)

#: Torso: height over stature, half width, half depth and shift ahead, all over stature.
_TORSO = np.array(
    [
        [0.530, 0.0960, 0.0680, -0.004],
        [0.570, 0.0920, 0.0650, -0.002],
        [0.615, 0.0870, 0.0620, 0.000],
        [0.660, 0.0900, 0.0650, 0.002],
        [0.705, 0.0965, 0.0690, 0.005],
        [0.745, 0.1020, 0.0690, 0.006],
        [0.778, 0.1040, 0.0640, 0.002],
        [0.800, 0.0950, 0.0560, -0.003],
        [0.818, 0.0740, 0.0470, -0.005],
        [0.832, 0.0510, 0.0410, -0.004],
        [0.845, 0.0380, 0.0370, 0.000],
    ]
)
_HIPS = np.array(
    [
        [0.455, 0.0700, 0.0480, -0.004],
        [0.475, 0.0930, 0.0660, -0.006],
        [0.505, 0.0990, 0.0720, -0.008],
        [0.540, 0.0955, 0.0670, -0.005],
        [0.575, 0.0890, 0.0620, -0.002],
    ]
)
#: Head: height over the chin and half width, half depth, shift ahead; over the head's height.
_HEAD = np.array(
    [
        [0.02, 0.150, 0.130, 0.160],
        [0.10, 0.215, 0.250, 0.110],
        [0.22, 0.270, 0.350, 0.060],
        [0.36, 0.300, 0.400, 0.030],
        [0.50, 0.320, 0.425, 0.010],
        [0.64, 0.330, 0.435, 0.000],
        [0.78, 0.315, 0.410, -0.005],
        [0.89, 0.250, 0.330, -0.005],
        [0.965, 0.150, 0.200, -0.005],
    ]
)
_SHOULDER, _SHOULDER_HALF = 0.783, 0.106
_UPPER_ARM, _FOREARM, _HAND = 0.172, 0.150, 0.090
_HIP, _HIP_HALF = 0.515, 0.052
_THIGH, _SHANK, _ANKLE = 0.240, 0.235, 0.045
_CHIN = 0.868
#: From the hips to the neck.
_SPINE = 0.30
#: From under the ankle to the ends of the shoe.
_TOE, _HEEL = 0.135, 0.035


@dataclass(frozen=True)
class _Legs:
    """Feet of one instant: ankle positions [m] and pitch of the soles [rad]; left, right."""

    ankles: tuple[NDArray, NDArray]
    pitches: tuple[float, float]
    pelvis: NDArray
    twist: float


class HumanBody:
    """One person: looks that are drawn once, and a mesh for every instant.

    Args:
        person: The scene file's section.
        seed: For everything that it leaves to chance.
        atlas: Where the textures go.
        contrast: Contrast of the clothes' textures.
        dark: Whether the upper garment is dark and plain unless the file says otherwise.
    """

    def __init__(
        self, person: Person, seed: int, atlas: Atlas, *, contrast: float = 1.0, dark: bool = False
    ) -> None:
        rng = np.random.default_rng([person.seed or seed, 17])
        self.height = person.height or float(np.clip(rng.normal(1.71, 0.10), 1.45, 1.95))
        self._h = self.height
        self._build = person.build or float(np.clip(rng.normal(1.0, 0.10), 0.84, 1.28))
        self._hips_wide = float(rng.uniform(0.94, 1.08))
        self._shoulders_wide = float(rng.uniform(0.93, 1.06))
        self._phase = float(rng.uniform(0, 2 * math.pi))

        def pick(value: str, options: list[str], weights: list[float]) -> str:
            chosen = str(rng.choice(options, p=np.array(weights) / sum(weights)))
            return chosen if value == "random" else value

        self._top = pick(person.top, ["pullover", "shirt", "jacket", "coat"], [5, 3, 3, 1])
        self._bottom = pick(person.bottom, ["trousers", "skirt", "shorts"], [8, 1, 1])
        cloth = pick(
            person.cloth, ["plain", "knit", "stripes", "checks", "print", "denim"],
            [4, 3, 1.5, 1.5, 2, 1],
        )  # fmt: skip
        shade = float(rng.choice([rng.uniform(0.04, 0.12), rng.uniform(0.12, 0.7)], p=[0.4, 0.6]))
        if dark and person.cloth == "random":
            cloth, shade = "plain", float(rng.uniform(0.04, 0.10))
        shade = person.shade or shade
        self._hair = pick(person.hair, ["short", "long", "bald", "cap"], [6, 4, 1, 1])
        self._bag = pick(person.bag, ["none", "backpack", "shoulder"], [7, 2, 1.5])
        self._lean = person.lean
        self._pose = pick(
            person.pose, ["hang", "pockets", "crossed", "hips", "phone", "behind"],
            [5, 2, 2, 0.7, 1.5, 1],
        )  # fmt: skip
        self._make_materials(rng, atlas, cloth, shade, contrast)
        self._folds = {
            name: _folds(rng, rings, segments, depth)
            for name, rings, segments, depth in (
                ("torso", 14, 20, 0.035), ("hips", 5, 20, 0.02), ("coat", 8, 20, 0.04),
                ("arm0", 13, 12, 0.06), ("arm1", 13, 12, 0.06),
                ("leg0", 16, 12, 0.05), ("leg1", 16, 12, 0.05),
            )
        }  # fmt: skip
        self._stance = (float(rng.uniform(0.05, 0.10)), float(rng.uniform(-0.06, 0.06)))
        self._look = float(rng.uniform(-0.35, 0.35))
        self._gesture = float(rng.uniform(0.6, 1.3))
        self._swing_arms = float(rng.uniform(0.6, 1.2))
        self._carries_with = int(math.sin(self._phase) > 0)
        self._load = np.random.default_rng([person.seed or seed, 18]).uniform(0.0, 1.0, 3)

    def _make_materials(
        self, rng: np.random.Generator, atlas: Atlas, cloth: str, shade: float, contrast: float
    ) -> None:
        tone = float(rng.uniform(0.18, 0.62))
        hair = float(rng.choice([0.04, 0.08, 0.16, 0.4, 0.6], p=[0.35, 0.3, 0.15, 0.12, 0.08]))
        self._cloth = atlas.add(textures.fabric(rng, cloth, shade, contrast))
        kind = str(rng.choice(["plain", "denim"]))
        legs = float(rng.choice([rng.uniform(0.05, 0.14), rng.uniform(0.14, 0.5)]))
        self._legs = atlas.add(textures.fabric(rng, kind, legs, contrast))
        self._skin = atlas.add(textures.skin(rng, tone))
        self._hair_material = atlas.add(textures.fabric(rng, "knit", hair, 1.0))
        self._shoes = atlas.add(textures.plain(rng, float(rng.choice([0.05, 0.1, 0.7])), contrast))
        self._bag_material = atlas.add(
            textures.fabric(rng, "plain", float(rng.uniform(0.05, 0.4)), contrast)
        )
        self._head_height = 0.132 * self._h * float(rng.uniform(0.96, 1.04))
        table = _HEAD * self._head_height
        around = math.pi * float(table[:, 1].mean() + table[:, 2].mean())
        self._head = atlas.add(
            textures.head(rng, tone, hair, self._hair, around, 1.02 * self._head_height)
        )

    def mesh(self, place: Place, time: float, *, talking: bool = False) -> Mesh:
        """The body at a place and time, in the map.

        Args:
            place: Where it is, and its way, from which the gait's phase follows.
            time: Time [s], for gestures.
            talking: Whether it gestures.
        """
        pace = min(1.0, abs(place.speed) / 0.5)
        legs = self._stand() if pace < 0.02 else self._walk(place, pace)
        neck = np.array([0.0, 0.0, legs.pelvis[2]])
        if self._lean:
            legs.pelvis[0] -= 0.5 * self._lean
            # The spine keeps its length.
            spine = _SPINE * self._h
            neck += [0.5 * self._lean, 0.0, math.sqrt(spine**2 - self._lean**2) - spine]
        bones = [self._leg_bones(legs, k) for k in (0, 1)]
        parts = [
            self._hips(legs, bones),
            self._torso(legs, neck, bones),
            *self._neck_and_head(neck, time),
            *self._leg(legs, bones[0], 0),
            *self._leg(legs, bones[1], 1),
        ]
        shoulder_twist = -1.2 * legs.twist
        parts += self._arm(neck, shoulder_twist, place, pace, time, 0, talking)
        parts += self._arm(neck, shoulder_twist, place, pace, time, 1, talking)
        parts += self._extras(neck, shoulder_twist)
        return merge(parts).placed(place.x, place.y, place.yaw)

    def stride(self, speed: float) -> float:
        """Way from one step of a foot to its next [m], at a speed [m/s]."""
        return (0.55 + 0.48 * min(abs(speed), 2.0)) * self._h / 1.7

    # ------------------------------------------------------------------------- legs ----

    def _stand(self) -> _Legs:
        h, (apart, shift) = self._h, self._stance
        sway = 0.004 * h
        ankles = (
            np.array([0.01 + shift, apart * 0.5 * h + 0.06, _ANKLE * h]),
            np.array([0.01 - shift, -apart * 0.5 * h - 0.06, _ANKLE * h]),
        )
        return _Legs(ankles, (0.0, 0.0), np.array([-0.01, sway, -0.002 * h]), 0.0)

    def _walk(self, place: Place, pace: float) -> _Legs:
        """Feet on the floor stay where they are while the body moves on."""
        h, speed = self._h, abs(place.speed)
        stride = self.stride(speed)
        phase = (place.way / stride + self._phase / (2 * math.pi)) % 1.0
        stance = 0.60
        reach = stance * stride
        ankles, pitches = [], []
        for k, side in enumerate((1.0, -1.0)):
            p = (phase + 0.5 * k) % 1.0
            lift = 0.0
            if p < stance:
                q = p / stance
                x = reach * (0.5 - q)
                pitch = 0.8 * max(0.0, (q - 0.7) / 0.3)
                if q < 0.12:
                    pitch = -0.25 * (1 - q / 0.12)
            else:
                q = (p - stance) / (1 - stance)
                soft = q * q * (3 - 2 * q)
                x = reach * (soft - 0.5)
                lift = 0.045 * h / 1.7 * math.sin(math.pi * q)
                pitch = 0.8 * (1 - soft) - 0.25 * soft
            x, lift, pitch = x * pace + 0.01 * (1 - pace), lift * pace, pitch * pace
            # Rolled over the toes or on the heel, the sole's lowest point is on the floor.
            rise = max(_TOE * math.sin(pitch), -_HEEL * math.sin(pitch))
            high = (_ANKLE * math.cos(pitch) + rise) * h + lift
            ankles.append(np.array([x - 0.02, side * (0.030 * h + 0.02), high]))
            pitches.append(pitch)
        # The stance leg is nearly straight in the middle of its phase; the body sinks in between.
        leg = (_THIGH + _SHANK) * h * 0.995
        lowest = min(
            math.sqrt(max(leg**2 - float(a[0] + 0.02) ** 2, 0.01)) + float(a[2]) for a in ankles
        )
        drop = min(-0.004 * h, lowest - _HIP * h + 0.02 * h)
        twist = 0.13 * pace * math.sin(2 * math.pi * (phase + 0.07))
        lean = -0.015 - 0.02 * min(speed, 2.0)
        return _Legs(
            (ankles[0], ankles[1]), (pitches[0], pitches[1]), np.array([lean, 0.0, drop]), twist
        )

    def _leg_bones(self, legs: _Legs, k: int) -> NDArray:
        """Hip, knee and ankle of the left (0) or right (1) leg, shape (3, 3)."""
        h, side = self._h, 1.0 - 2.0 * k
        c, s = math.cos(legs.twist), math.sin(legs.twist)
        half = side * _HIP_HALF * h * self._hips_wide
        hip = legs.pelvis + np.array([-s * half, c * half, _HIP * h])
        pole = np.array([1.0, 0.12 * side, 0.0])
        knee, ankle = _two_bones(hip, legs.ankles[k], _THIGH * h, _SHANK * h, pole)
        return np.array([hip, knee, ankle])

    def _around_legs(
        self, bones: list[NDArray], z: NDArray, middle: NDArray, half_depth: NDArray
    ) -> NDArray:
        """Half depths of a skirt or coat at heights z, so that no leg comes through it."""
        for one in bones:
            heights, ahead = one[::-1, 2], one[::-1, 0]
            reach = np.abs(np.interp(z, heights, ahead) - middle) + 0.062 * self._h
            half_depth = np.maximum(half_depth, reach * (z < one[0, 2]))
        return half_depth

    def _leg(self, legs: _Legs, bones: NDArray, k: int) -> list[Mesh]:
        h, b = self._h, self._build
        side = 1.0 - 2.0 * k
        hip, knee, ankle = bones
        bare = self._bottom != "trousers"
        wide = 1.0 if bare else 1.12
        radii = np.array([0.058, 0.053, 0.045, 0.037, 0.0345, 0.034, 0.029, 0.0235])
        if not bare:
            radii = np.maximum(
                radii, np.array([0.058, 0.05, 0.04, 0.035, 0.033, 0.034, 0.033, 0.033])
            )
        front = np.array([1.0, 0.0, 0.0])
        mid1, mid2 = 0.5 * (hip + knee), 0.5 * (knee + ankle)
        radius = radii * h * wide * b**0.7
        points = np.array([hip, mid1, knee, mid2, ankle])
        material = self._skin if bare else self._legs
        parts = [
            tube(
                points, radius, front, material, rings=16, bumps=self._folds[f"leg{k}"] * (not bare)
            )
        ]
        if self._bottom == "shorts":
            parts.append(
                tube(
                    np.array([hip, mid1, knee + 0.1 * (hip - knee)]),
                    np.array([0.068, 0.062, 0.056]) * h * b**0.7,
                    front,
                    self._legs,
                    rings=6,
                )
            )
        parts.append(self._shoe(ankle, legs.pitches[k], side))
        return parts

    def _shoe(self, ankle: NDArray, pitch: float, side: float) -> Mesh:
        h = self._h
        ahead = np.array([math.cos(pitch), 0.12 * side, -math.sin(pitch)])
        ahead /= np.linalg.norm(ahead)
        up = np.cross(ahead, np.array([0.0, 1.0, 0.0]))
        up *= np.sign(up[2])
        across = np.cross(up, ahead)
        sole = ankle - up * (_ANKLE * h)
        centre = sole + ahead * 0.045 * h + up * 0.024 * h
        length = np.linspace(-0.075, 0.085, 6) * h
        centres = centre + length[:, None] * ahead
        return loft(
            centres,
            across,
            up,
            np.array([0.020, 0.024, 0.024, 0.028, 0.029, 0.020]) * h,
            np.array([0.024, 0.030, 0.030, 0.024, 0.018, 0.013]) * h,
            self._shoes,
            segments=12,
            round_ends=(0.005, 0.01),
        )

    # ------------------------------------------------------------------------ torso ----

    def _rings(
        self, table: NDArray, twist: float, shift: NDArray, *, wide: NDArray | float = 1.0
    ) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
        h, b = self._h, self._build
        centres = np.stack([table[:, 3] * h, np.zeros(len(table)), table[:, 0] * h], axis=1) + shift
        c, s = math.cos(twist), math.sin(twist)
        side, front = np.array([-s, c, 0.0]), np.array([c, s, 0.0])
        belly = 1.0 + max(0.0, b - 1.0) * 1.2 * np.exp(-(((table[:, 0] - 0.62) / 0.06) ** 2))
        return centres, side, front, table[:, 1] * h * b * wide, table[:, 2] * h * b * belly * wide

    def _hips(self, legs: _Legs, bones: list[NDArray]) -> Mesh:
        table = _HIPS.copy()
        table[:, 1] *= self._hips_wide
        if self._bottom == "skirt":
            flare = np.array(
                [[0.29, 0.138, 0.122, 0.0], [0.36, 0.128, 0.112, 0.0], [0.43, 0.115, 0.098, 0.0]]
            )
            table = np.concatenate([flare, table[1:]])
        shift = np.stack([np.full(len(table), legs.pelvis[k]) for k in range(3)], axis=1)
        centres, side, front, a, d = self._rings(table, legs.twist, shift, wide=1.02)
        bumps = self._folds["hips"] if len(table) == 5 else None
        if self._bottom == "skirt":
            d = self._around_legs(bones, centres[:, 2], centres[:, 0], d)
        return loft(
            centres, side, front, a, d, self._legs, segments=20, power=2.4, bumps=bumps,
            round_ends=(0.01, 0.01),
        )  # fmt: skip

    def _torso(self, legs: _Legs, neck: NDArray, bones: list[NDArray]) -> Mesh:
        table = _TORSO.copy()
        upper = np.clip((table[:, 0] - 0.66) / 0.12, 0, 1)
        table[:, 1] *= upper * self._shoulders_wide + (1 - upper) * self._hips_wide
        wide = {"pullover": 1.07, "shirt": 1.02, "jacket": 1.12, "coat": 1.15}[self._top]
        ease = np.full(len(table), wide)
        ease[-4:] = (1.0 + 0.5 * (wide - 1.0), 1.0 + 0.3 * (wide - 1.0), 1.0, 1.0)
        if self._top in ("pullover", "jacket", "coat"):
            hem = np.array([[0.485, 0.1050, 0.0820, -0.004], [0.505, 0.1030, 0.0780, -0.005]])
            table, ease = np.concatenate([hem, table]), np.concatenate([[wide, wide], ease])
        if self._top == "coat":
            hem = np.array([[0.27, 0.122, 0.105, 0.0], [0.35, 0.115, 0.096, 0.0],
                            [0.43, 0.107, 0.085, -0.004]])  # fmt: skip
            table, ease = np.concatenate([hem, table]), np.concatenate([[1.0, 1.02, 1.05], ease])
        # From the pelvis to the neck the spine leads over.
        up = np.clip((table[:, 0] - 0.53) / (0.83 - 0.53), 0.0, 1.0)[:, None]
        up = up * up * (3 - 2 * up)
        shift = legs.pelvis * (1 - up) + neck * up
        centres, _, _, a, d = self._rings(table, 0.0, shift, wide=ease)
        if self._top == "coat":
            d = self._around_legs(bones, centres[:, 2], centres[:, 0], d)
        twist = (legs.twist * (1 - up) - 1.2 * legs.twist * up)[:, 0]
        side = np.stack([-np.sin(twist), np.cos(twist), 0 * twist], axis=1)
        front = np.stack([np.cos(twist), np.sin(twist), 0 * twist], axis=1)
        bumps = np.zeros((len(table), 20))
        rows = min(len(table) - 3, 14)
        bumps[:rows] = self._folds["torso"][:rows]
        return loft(
            centres, side, front, a, d, self._cloth, segments=20, power=2.3, bumps=bumps,
            round_ends=(0.005, 0.0),
        )  # fmt: skip

    def _neck_and_head(self, neck: NDArray, time: float) -> list[Mesh]:
        h, tall = self._h, self._head_height
        base, chin = neck + 0.825 * h * _Z, neck + np.array([0.012 * h, 0.0, _CHIN * h])
        parts = [
            tube(
                np.array([base, chin + 0.03 * h * _Z - 0.008 * h * _X]),
                np.array([0.037, 0.033, 0.033]) * h * self._build**0.4,
                _X,
                self._skin,
                rings=5,
            )
        ]
        yaw = self._look + 0.15 * math.sin(0.9 * time + self._phase)
        c, s = math.cos(yaw), math.sin(yaw)
        front, side = np.array([c, s, 0.0]), np.array([-s, c, 0.0])
        table = _HEAD * tall
        low = np.array([neck[0], neck[1], self._h - tall + neck[2]])
        centres = table[:, 3:4] * front + low + table[:, :1] * _Z
        parts.append(
            loft(
                centres,
                side,
                front,
                table[:, 1],
                table[:, 2],
                self._head,
                segments=18,
                power=2.1,
                round_ends=(0.0, 0.035 * tall),
            )
        )
        nose = centres[3] + front * 0.41 * tall
        parts.append(
            ellipsoid(nose, np.array([front, side, _Z]), (0.05 * tall, 0.05 * tall, 0.11 * tall),
                      self._skin)
        )  # fmt: skip
        return [*parts, *self._hair_or_cap(front, side, low)]

    def _hair_or_cap(self, front: NDArray, side: NDArray, low: NDArray) -> list[Mesh]:
        """On a head that faces `front`, its chin over or under the point `low` [m]."""
        tall = self._head_height
        axes = np.array([front, side, _Z])

        def part(middle: NDArray, size: tuple[float, float, float], material: int) -> Mesh:
            return ellipsoid(
                middle, axes, (size[0] * tall, size[1] * tall, size[2] * tall), material
            )

        if self._hair == "long":
            middle = low + 0.30 * tall * _Z - 0.17 * tall * front
            return [part(middle, (0.36, 0.37, 0.66), self._hair_material)]
        if self._hair == "short":
            middle = low + 0.69 * tall * _Z - 0.035 * tall * front
            return [part(middle, (0.435, 0.345, 0.335), self._hair_material)]
        if self._hair == "bun":
            middle = low + 0.69 * tall * _Z - 0.035 * tall * front
            knot = low + 0.86 * tall * _Z - 0.42 * tall * front
            return [
                part(middle, (0.435, 0.345, 0.335), self._hair_material),
                part(knot, (0.17, 0.17, 0.17), self._hair_material),
            ]
        if self._hair == "hat":
            middle = low + 0.80 * tall * _Z
            return [
                part(middle, (0.68, 0.62, 0.05), self._bag_material),
                part(middle + 0.08 * tall * _Z, (0.43, 0.36, 0.34), self._bag_material),
            ]
        if self._hair == "hood":
            middle = low + 0.48 * tall * _Z - 0.12 * tall * front
            return [part(middle, (0.47, 0.46, 0.62), self._cloth)]
        if self._hair == "cap":
            middle = low + 0.76 * tall * _Z
            brim = middle + 0.42 * tall * front
            return [
                part(middle, (0.46, 0.36, 0.27), self._cloth),
                part(brim, (0.32, 0.27, 0.03), self._cloth),
            ]
        return []

    # ------------------------------------------------------------------------- arms ----

    def _arm(
        self,
        neck: NDArray,
        twist: float,
        place: Place,
        pace: float,
        time: float,
        k: int,
        talking: bool,
    ) -> list[Mesh]:
        h = self._h
        side = 1.0 - 2.0 * k
        c, s = math.cos(twist), math.sin(twist)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        half = _SHOULDER_HALF * self._shoulders_wide * self._build**0.5
        shoulder = neck + turn @ np.array([-0.004 * h, side * half * h, _SHOULDER * h])
        wrist, pole = self._wrist(place, pace, time, k, talking)
        wrist = neck + turn @ wrist
        elbow, wrist = _two_bones(shoulder, wrist, _UPPER_ARM * h, _FOREARM * h, turn @ pole)
        bare = self._top == "shirt"
        ease = {"pullover": 1.15, "shirt": 1.0, "jacket": 1.24, "coat": 1.28}[self._top]
        radii = np.array([0.031, 0.0305, 0.027, 0.0245, 0.0235, 0.021, 0.0165]) * h
        radii *= self._build**0.6 * (1.0 if bare else ease)
        front = turn @ _X
        points = np.array([shoulder, 0.5 * (shoulder + elbow), elbow, 0.5 * (elbow + wrist), wrist])
        parts = [
            tube(
                points, radii, front, self._skin if bare else self._cloth, rings=13,
                bumps=self._folds[f"arm{k}"] * (not bare), round_ends=(0.028 * h, 0.005),
            )
        ]  # fmt: skip
        if bare:
            sleeve = np.array([shoulder, shoulder + 0.35 * (elbow - shoulder),
                               shoulder + 0.7 * (elbow - shoulder)])  # fmt: skip
            wide = np.array([0.036, 0.036, 0.034]) * h * self._build**0.6
            parts.append(
                tube(sleeve, wide, front, self._cloth, rings=6, round_ends=(0.03 * h, 0.0))
            )
        along = wrist - elbow
        along /= max(float(np.linalg.norm(along)), 1e-6)
        across = np.cross(along, np.array([0.3, side, 0.1]))
        across /= np.linalg.norm(across)
        axes = np.array([across, np.cross(along, across), along])
        hand = wrist + along * 0.045 * h
        parts.append(ellipsoid(hand, axes, (0.024 * h, 0.013 * h, 0.055 * h), self._skin))
        return parts

    def _wrist(
        self, place: Place, pace: float, time: float, k: int, talking: bool
    ) -> tuple[NDArray, NDArray]:
        """Where the wrist is, relative to the foot of the neck, and where the elbow points."""
        h, side = self._h, 1.0 - 2.0 * k
        girth = self._build
        back = np.array([-1.0, 0.6 * side, -0.3])
        hang = np.array([0.03, side * (0.135 + 0.02 * (girth - 1)), 0.478]) * [h, h * girth**0.5, h]
        poses = {
            "hang": (hang, back),
            "pockets": (np.array([0.055, side * 0.118 * girth, 0.515]) * h, back),
            "crossed": (
                np.array([0.115 * girth, -side * 0.050, 0.675 + 0.02 * k]) * h,
                np.array([0.1, side, -0.8]),
            ),
            "hips": (np.array([0.02, side * 0.125 * girth, 0.575]) * h, np.array([-0.6, side, 0])),
            "behind": (
                np.array([-0.105 * girth, side * 0.02, 0.53]) * h,
                np.array([-0.7, side, -0.3]),
            ),
            "phone": (
                (np.array([0.17, 0.03 * side, 0.69]) * h if k else hang),
                (np.array([-0.2, side, -1.0]) if k else back),
            ),
            "point": (
                (np.array([0.27, 0.10 * side, 0.76]) * h if k else hang),
                (np.array([-0.1, side, -1.0]) if k else back),
            ),
            "raised": (np.array([0.03, side * 0.17, 1.04]) * h, np.array([-0.2, side, 0.0])),
        }
        carried = self._carrying_wrist(k)
        if carried is not None:
            return carried, back
        wrist, pole = poses.get(self._pose, poses["hang"])
        if talking or self._pose == "talk":
            t = self._gesture * time * 2.5 + self._phase + 1.3 * k
            move = np.array(
                [0.03 * math.sin(t), 0.05 * math.sin(1.3 * t), 0.05 * math.sin(0.8 * t)]
            )
            wrist = np.array([0.15 * girth, side * 0.09, 0.62]) * h + move * h / 1.7
            pole = np.array([-0.5, side, -1.0])
        swings = self._pose in ("hang", "hips", "behind", "pockets", "talk", "crossed") or not k
        if pace > 0.0 and swings:
            wrist = wrist * (1 - pace) + self._swung_wrist(place, side) * pace
            pole = pole * (1 - pace) + back * pace
        return wrist, pole

    def _carrying_wrist(self, k: int) -> NDArray | None:
        """Where the wrist is, relative to the foot of the neck, if this arm holds something."""
        h, side, girth = self._h, 1.0 - 2.0 * k, self._build
        if self._bag == "box":
            return np.array([0.17 * girth, side * 0.10, 0.60]) * h
        if self._bag == "coat" and k == self._carries_with:
            return np.array([0.14 * girth, side * 0.06, 0.61]) * h
        if self._bag == "hand" and k == self._carries_with:
            return np.array([0.0, side * 0.145 * girth**0.5, 0.470]) * h
        return None

    def _swung_wrist(self, place: Place, side: float) -> NDArray:
        """Where the wrist is while walking: arms swing against the legs."""
        h, girth = self._h, self._build
        stride = self.stride(place.speed)
        phase = (place.way / stride + self._phase / (2 * math.pi)) % 1.0
        angle = -self._swing_arms * (0.25 + 0.15 * min(abs(place.speed), 2.0)) * side
        angle *= math.cos(2 * math.pi * phase)
        reach = (_UPPER_ARM + _FOREARM) * 0.985 * h
        return np.array(
            [
                reach * math.sin(angle + 0.12),
                side * 0.135 * h * girth**0.5,
                _SHOULDER * h - reach * math.cos(angle + 0.12),
            ]
        )

    # ----------------------------------------------------------------------- extras ----

    def _extras(self, neck: NDArray, twist: float) -> list[Mesh]:
        h, b = self._h, self._build
        c, s = math.cos(twist), math.sin(twist)
        front, side = np.array([c, s, 0.0]), np.array([-s, c, 0.0])
        axes = np.array([front, side, _Z])
        if self._bag == "backpack":
            middle = neck + front * (-(0.07 * b + 0.055) * h - 0.4 * self._lean) + 0.69 * h * _Z
            z = np.linspace(-0.13, 0.13, 6) * h
            return [
                loft(
                    middle + z[:, None] * _Z, side, front, np.full(6, 0.085 * h),
                    np.array([0.06, 0.062, 0.058, 0.054, 0.048, 0.04]) * h, self._bag_material,
                    segments=16, power=3.0, round_ends=(0.01, 0.03),
                )
            ]  # fmt: skip
        if self._bag == "shoulder":
            hand = 1.0 if math.sin(self._phase) > 0 else -1.0
            middle = neck + side * hand * 0.15 * b * h + 0.50 * h * _Z - front * 0.03 * h
            strap = np.array(
                [
                    neck - side * hand * 0.05 * h + 0.83 * h * _Z + front * 0.03 * h,
                    neck + front * 0.09 * b * h + 0.70 * h * _Z,
                    middle + 0.06 * h * _Z,
                ]
            )
            return [
                ellipsoid(middle, axes, (0.085 * h, 0.035 * h, 0.075 * h), self._bag_material),
                tube(strap, np.full(3, 0.009 * h), front, self._bag_material, rings=8, segments=6),
            ]
        if self._bag in ("hand", "box", "coat"):
            return [self._load_mesh().placed(neck[0], neck[1], twist, neck[2])]
        return []

    def _load_mesh(self) -> Mesh:
        """What the hands hold, before or beside an upright body that faces x."""
        h, load = self._h, self._load
        side = 1.0 - 2.0 * self._carries_with
        if self._bag == "box":
            size = np.array([0.22, 0.26, 0.16]) + load * [0.14, 0.2, 0.24]
            ahead = (0.11 * self._build + 0.02) * h + size[0] / 2
            low = 0.575 * h
            return box((ahead, 0.0, low + size[2] / 2), tuple(size), self._bag_material)
        wrist = self._carrying_wrist(self._carries_with)
        assert wrist is not None
        if self._bag == "hand":
            size = np.array([0.26, 0.07, 0.24]) + load * [0.16, 0.12, 0.16]
            top = wrist[2] - 0.07 * h
            return box((wrist[0], wrist[1], top - size[2] / 2), tuple(size), self._bag_material)
        # Folded over the forearm, which it hides.
        long = 0.35 + 0.3 * load[0]
        z = wrist[2] + np.array([0.05, 0.04, 0.0, -0.5 * long, -long])
        ahead, aside = 0.75 * wrist[0], side * 0.095 * h
        centres = np.array([ahead, aside, 0.0]) + z[:, np.newaxis] * _Z
        return loft(
            centres, _Y, _X, np.array([0.09, 0.12, 0.13, 0.13, 0.14]),
            np.array([0.03, 0.06, 0.07, 0.06, 0.055]), self._bag_material, segments=16, power=2.6,
        )  # fmt: skip


def _folds(rng: np.random.Generator, rings: int, segments: int, depth: float) -> NDArray:
    """Relative change of radii where cloth lies in folds, shape (rings, segments)."""
    raw = rng.normal(0.0, 1.0, (rings, segments))
    smooth = (raw + np.roll(raw, 1, 1) + np.roll(raw, -1, 1)) / 1.7
    return depth * np.clip(smooth, -2.0, 2.0) * 0.5


def _two_bones(
    start: NDArray, end: NDArray, first: float, second: float, pole: NDArray
) -> tuple[NDArray, NDArray]:
    """The joint between two bones, bent towards `pole`, and the end, drawn in if out of reach."""
    along = end - start
    reach = float(np.linalg.norm(along))
    along = along / max(reach, 1e-6)
    limit = (first + second) * 0.999
    reach = min(max(reach, abs(first - second) * 1.01), limit)
    bent = pole - along * float(pole @ along)
    bent /= max(float(np.linalg.norm(bent)), 1e-6)
    to_joint = (first**2 - second**2 + reach**2) / (2 * reach)
    aside = math.sqrt(max(first**2 - to_joint**2, 0.0))
    return start + along * to_joint + bent * aside, start + along * reach
