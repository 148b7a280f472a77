"""Procedural textures, and the atlas from which hits are shaded.

A texture is a tile of reflectances that repeats; it is tied to the surface by texture coordinates,
so every camera sees the same pattern at the same place. Each is kept at halved resolutions too
(mipmaps): a pixel that covers much of the surface gets the mean over it and does not alias.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Float32

Rng = np.random.Generator


@dataclass(frozen=True)
class Texture:
    """One tile.

    Attributes:
        image: Reflectance 0..1, float32, shape (h, w), both powers of two; row 0 is v = 0.
        size: Width and height of the tile on the surface [m].
    """

    image: Float32
    size: tuple[float, float]


@dataclass
class Atlas:
    """All textures of a scene in one array, sampled for many hits at once."""

    _data: list[Float32] = field(default_factory=list)
    _base: list[list[int]] = field(default_factory=list)
    _shape: list[tuple[int, int]] = field(default_factory=list)
    _scale: list[tuple[float, float]] = field(default_factory=list)
    _filled: int = 0
    _packed: tuple | None = None

    def add(self, texture: Texture) -> int:
        """Takes a texture in and returns its material index."""
        image = np.ascontiguousarray(texture.image, dtype=np.float32)
        h, w = image.shape
        if h & (h - 1) or w & (w - 1):
            raise ValueError(f"texture is {w}x{h} px; wanted: powers of two")
        self._shape.append((int(math.log2(h)), int(math.log2(w))))
        self._scale.append((w / texture.size[0], h / texture.size[1]))
        bases = []
        while True:
            bases.append(self._filled)
            self._data.append(image.ravel())
            self._filled += image.size
            if min(image.shape) <= 2:
                break
            image = 0.25 * (
                image[::2, ::2] + image[1::2, ::2] + image[::2, 1::2] + image[1::2, 1::2]
            )
        self._base.append(bases)
        self._packed = None
        return len(self._base) - 1

    def _pack(self) -> tuple:
        if self._packed is None:
            levels = max(len(b) for b in self._base)
            base = np.array([b + [b[-1]] * (levels - len(b)) for b in self._base], dtype=np.int32)
            self._packed = (
                np.concatenate(self._data),
                base,
                np.array([len(b) - 1 for b in self._base], dtype=np.float32),
                np.array(self._shape, dtype=np.int32),
                np.array(self._scale, dtype=np.float32),
            )
        return self._packed

    def sample(self, material: NDArray, uv: Float32, footprint: Float32) -> Float32:
        """Reflectance at places of surfaces.

        Args:
            material: Material indices, shape (n,).
            uv: Texture coordinates [m], shape (n, 2).
            footprint: Side of the surface patch to average over [m], shape (n,).

        Returns:
            float32, shape (n,).
        """
        data, base, last, shape, scale = self._pack()
        texels = uv * scale[material]
        # The finer of a texture's two resolutions decides.
        level = np.log2(np.maximum(footprint * scale[material].max(axis=1), 1e-6))
        level = np.clip(level, 0.0, last[material])
        low = np.floor(level)
        part = level - low
        low = low.astype(np.int32)
        high = np.minimum(low + 1, last[material].astype(np.int32))
        log_h, log_w = shape[material].T
        fine = _bilinear(data, base[material, low], texels, low, log_w, log_h)
        coarse = _bilinear(data, base[material, high], texels, high, log_w, log_h)
        return fine + part * (coarse - fine)


def _bilinear(
    data: Float32, base: NDArray, texels: Float32, level: NDArray, log_w: NDArray, log_h: NDArray
) -> Float32:
    shrink = np.ldexp(np.float32(1.0), -level).astype(np.float32)
    x = texels[:, 0] * shrink - 0.5
    y = texels[:, 1] * shrink - 0.5
    x0, y0 = np.floor(x), np.floor(y)
    fx, fy = x - x0, y - y0
    shift = log_w - level
    mask_x, mask_y = (1 << shift) - 1, (1 << (log_h - level)) - 1
    i0, j0 = x0.astype(np.int32), y0.astype(np.int32)
    left, right = i0 & mask_x, (i0 + 1) & mask_x
    upper = base + ((j0 & mask_y) << shift)
    lower = base + (((j0 + 1) & mask_y) << shift)
    top = data[upper + left] * (1 - fx) + data[upper + right] * fx
    bottom = data[lower + left] * (1 - fx) + data[lower + right] * fx
    return top * (1 - fy) + bottom * fy


# ---------------------------------------------------------------------------- patterns ----


def noise(
    rng: Rng,
    shape: tuple[int, int],
    size: tuple[float, float],
    *,
    finest: float,
    coarsest: float,
    slope: float = 1.0,
    stretch: float = 1.0,
) -> Float32:
    """Random pattern with all scales between two, tiling, zero mean and unit deviation.

    Args:
        rng: Source of randomness.
        shape: Height and width [px].
        size: Width and height [m].
        finest: Shortest wavelength [m].
        coarsest: Longest wavelength [m].
        slope: Amplitude falls with frequency to this power; 0 is white, 2 is cloudy.
        stretch: How much longer patterns are along v than along u.
    """
    h, w = shape
    fy = np.fft.fftfreq(h, size[1] / h)[:, None] * stretch
    fx = np.fft.rfftfreq(w, size[0] / w)[None, :]
    f = np.hypot(fx, fy)
    band = (f > 0) * np.maximum(f, 1.0 / coarsest) ** -slope * np.exp(-((f * finest) ** 2))
    spectrum = np.fft.rfft2(rng.standard_normal((h, w), dtype=np.float32)) * band
    image = np.fft.irfft2(spectrum, s=(h, w)).astype(np.float32)
    return image / max(float(image.std()), 1e-9)


def _finish(image: NDArray, mean: float, contrast: float) -> Float32:
    """Scales the pattern's contrast about its mean and keeps it a reflectance."""
    own = float(np.mean(image))
    return np.clip(mean + (image - own) * contrast, 0.01, 0.98).astype(np.float32)


def plaster(rng: Rng, mean: float = 0.6, contrast: float = 1.0) -> Texture:
    """A painted wall: faint, at every scale."""
    size = (4.0, 4.0)
    image = 0.05 * noise(rng, (512, 512), size, finest=0.016, coarsest=1.5, slope=1.0)
    image += 0.02 * noise(rng, (512, 512), size, finest=0.016, coarsest=0.05, slope=0.2)
    return Texture(_finish(image, mean, contrast), size)


def concrete(rng: Rng, mean: float = 0.45, contrast: float = 1.0) -> Texture:
    """Raw concrete or terrazzo: strong speckle."""
    size = (4.0, 4.0)
    image = 0.07 * noise(rng, (1024, 1024), size, finest=0.012, coarsest=0.6, slope=0.7)
    return Texture(_finish(image, mean, contrast), size)


def carpet(rng: Rng, mean: float = 0.35, contrast: float = 1.0) -> Texture:
    """A carpet: fine fibres and broad marks."""
    size = (2.0, 2.0)
    image = 0.06 * noise(rng, (512, 512), size, finest=0.01, coarsest=0.2, slope=0.3)
    image += 0.05 * noise(rng, (512, 512), size, finest=0.1, coarsest=1.0, slope=1.0)
    return Texture(_finish(image, mean, contrast), size)


def wood(rng: Rng, mean: float = 0.45, contrast: float = 1.0) -> Texture:
    """Grain along v."""
    size = (1.0, 1.0)
    image = 0.08 * noise(rng, (512, 512), size, finest=0.006, coarsest=0.2, slope=0.8, stretch=12.0)
    return Texture(_finish(image, mean, contrast), size)


def planks(rng: Rng, mean: float = 0.45, contrast: float = 1.0) -> Texture:
    """A floor of boards, 0.125 m wide."""
    size = (2.0, 2.0)
    image = 0.05 * noise(rng, (512, 512), size, finest=0.006, coarsest=0.2, stretch=12.0)
    for k in range(16):
        strip = slice(k * 32, k * 32 + 32)
        image[:, strip] += rng.normal(0, 0.05)
        image[:, k * 32] -= 0.12
        image[int(rng.integers(512)), strip] -= 0.12
        image[:, strip] = np.roll(image[:, strip], int(rng.integers(512)), axis=0)
    return Texture(_finish(image, mean, contrast), size)


def tiles(rng: Rng, mean: float = 0.55, contrast: float = 1.0, side: float = 0.5) -> Texture:
    """Square tiles with joints, each a little different."""
    n = 8
    px = 128
    size = (n * side, n * side)
    image = 0.035 * noise(rng, (n * px, n * px), size, finest=0.012, coarsest=0.4, slope=0.8)
    shade = rng.normal(0, 0.035, (n, n))
    image += np.kron(shade, np.ones((px, px)))
    joint = max(1, int(0.008 / side * px))
    for k in range(n):
        image[k * px : k * px + joint] -= 0.15
        image[:, k * px : k * px + joint] -= 0.15
    return Texture(_finish(image, mean, contrast), size)


def brick(rng: Rng, mean: float = 0.4, contrast: float = 1.0) -> Texture:
    """A brick wall."""
    size = (2.0, 2.0)
    h = w = 512
    image = 0.05 * noise(rng, (h, w), size, finest=0.008, coarsest=0.1, slope=0.6)
    rows, columns = 32, 8
    bh, bw = h // rows, w // columns
    for r in range(rows):
        for c in range(columns):
            x = c * bw + (bw // 2) * (r % 2)
            cols = np.arange(x, x + bw) % w
            image[r * bh : (r + 1) * bh, cols] += rng.normal(0, 0.06)
            image[r * bh : (r + 1) * bh, cols[:2]] += 0.14
        image[r * bh : r * bh + 2] += 0.14
    return Texture(_finish(image, mean, contrast), size)


def wallpaper(rng: Rng, mean: float = 0.6, contrast: float = 1.0) -> Texture:
    """Stripes or flecks, the same again and again: hard for a matcher."""
    size = (2.0, 2.0)
    u = np.arange(512) / 512 * 2.0
    period = 2.0 / rng.integers(12, 28)
    stripes = 0.05 * np.sin(2 * np.pi * u / period)[None, :] * np.ones((512, 1))
    flecks = 0.03 * noise(rng, (512, 512), size, finest=0.015, coarsest=0.3, slope=0.8)
    return Texture(_finish(stripes + flecks, mean, contrast), size)


def plain(rng: Rng, mean: float = 0.5, contrast: float = 1.0) -> Texture:
    """Paint, plastic or metal: nearly nothing to see."""
    size = (1.0, 1.0)
    image = 0.012 * noise(rng, (128, 128), size, finest=0.03, coarsest=0.5, slope=1.0)
    return Texture(_finish(image, mean, contrast), size)


def speckle(rng: Rng, mean: float = 0.5, contrast: float = 1.0) -> Texture:
    """Strong texture at all scales, for tests of the geometry."""
    size = (4.0, 4.0)
    image = 0.16 * noise(rng, (1024, 1024), size, finest=0.03, coarsest=0.4, slope=0.7)
    return Texture(_finish(image, mean, contrast), size)


def leaves(rng: Rng, mean: float = 0.25, contrast: float = 1.0) -> Texture:
    """Foliage."""
    size = (0.5, 0.5)
    image = 0.10 * noise(rng, (128, 128), size, finest=0.02, coarsest=0.15, slope=0.6)
    return Texture(_finish(image, mean, contrast), size)


def books(rng: Rng, mean: float = 0.45, contrast: float = 1.0) -> Texture:
    """Backs of books in a row, 0.25 m high."""
    w, h = 512, 128
    image = np.zeros((h, w), dtype=np.float32)
    x = 0
    while x < w:
        wide = int(rng.integers(6, 24))
        shade = rng.uniform(-0.35, 0.35)
        image[:, x : x + wide] = shade
        image[:, x : x + 1] = -0.4
        if rng.random() < 0.7:
            y = int(rng.integers(10, 90))
            image[y : y + int(rng.integers(8, 30)), x + 2 : x + wide - 1] = -shade
        image[h - int(rng.integers(2, 24)) :, x : x + wide] = -0.4
        x += wide
    return Texture(_finish(image, mean, contrast), (1.0, 0.25))


def poster(rng: Rng, width: float, height: float) -> Texture:
    """A printed sheet: a picture, headlines and lines of text."""
    w, h = 128, 128
    image = np.full((h, w), rng.uniform(0.6, 0.9), dtype=np.float32)
    top = int(rng.integers(40, 90))
    picture = noise(rng, (128, 128), (1.0, 1.0), finest=0.03, coarsest=0.6, slope=1.2)
    image[6:top, 6 : w - 6] = (0.45 + 0.18 * picture)[6:top, 6 : w - 6]
    for _ in range(int(rng.integers(1, 5))):
        at = (int(rng.integers(w)), int(rng.integers(6, top)))
        cv2.circle(image, at, int(rng.integers(5, 25)), float(rng.uniform(0.05, 0.95)), -1)
    y = top + 6
    while y < h - 8:
        tall = int(rng.integers(2, 5))
        x = 8
        while x < w - 20:
            wide = int(rng.integers(4, 20))
            image[y : y + tall, x : x + wide] = rng.uniform(0.05, 0.3)
            x += wide + 3
        y += tall + 4
    image = image[::-1]  # v grows upwards
    return Texture(np.clip(image, 0.02, 0.95), (width, height))


def screen(rng: Rng, width: float, height: float) -> Texture:
    """What a monitor shows: windows and text, or black."""
    w, h = 128, 128
    image = np.full((h, w), 0.03, dtype=np.float32)
    if rng.random() < 0.7:
        image[:] = rng.uniform(0.2, 0.6)
        for _ in range(4):
            x, y = rng.integers(0, 90, 2)
            dx, dy = rng.integers(20, 80, 2)
            image[y : y + dy, x : x + dx] = rng.uniform(0.1, 0.95)
            for line in range(y + 4, min(y + dy, h - 3), 6):
                image[line : line + 2, x + 3 : x + int(rng.integers(8, 70))] = rng.uniform(0, 1)
    return Texture(np.clip(image, 0.02, 0.95).astype(np.float32), (width, height))


def door(rng: Rng, width: float, height: float) -> Texture:
    """A door leaf with frame, panels or a window, and handle."""
    w, h = 128, 256
    base = rng.uniform(0.25, 0.75)
    image = base + 0.03 * noise(rng, (h, w), (1.0, 2.0), finest=0.02, coarsest=0.3, stretch=8)
    frame = np.clip(base + rng.choice([-0.25, 0.25]), 0.05, 0.95)
    image[:, :6] = image[:, -6:] = image[-6:] = frame
    if rng.random() < 0.5:
        image[130:230, 30:98] = rng.uniform(0.05, 0.3)
    else:
        for y in (20, 90, 160):
            cv2.rectangle(image, (22, y), (106, y + 55), float(base - 0.12), 2)
    image[118:124, 104:118] = 0.9
    return Texture(np.clip(image, 0.02, 0.95).astype(np.float32), (width, height))


def beyond(rng: Rng, width: float, height: float) -> Texture:
    """What is seen through an open door: another room, light or dark, with floor and edges."""
    w, h = 128, 256
    wall = float(rng.choice([rng.uniform(0.03, 0.15), rng.uniform(0.15, 0.8)]))
    image = wall + 0.03 * noise(rng, (h, w), (1.0, 2.0), finest=0.03, coarsest=0.6)
    for _ in range(int(rng.integers(0, 4))):
        at = int(rng.integers(w))
        image[:, at : at + int(rng.integers(3, 40))] = wall * rng.uniform(0.3, 1.8)
    image[: int(rng.integers(10, 40))] = rng.uniform(0.05, 0.5)
    return Texture(np.clip(image, 0.02, 0.95).astype(np.float32), (width, height))


def blinds(rng: Rng, contrast: float = 1.0) -> Texture:
    """A window: slats across or upright, bars, or daylight alone."""
    side, size = 128, (1.0, 1.0)
    light = rng.uniform(0.5, 0.95)
    image = light + 0.03 * contrast * noise(rng, (side, side), size, finest=0.05, coarsest=0.5)
    kind = str(rng.choice(["slats", "upright", "bars", "none"], p=[0.35, 0.3, 0.15, 0.2]))
    if kind != "none":
        pitch = {"slats": 4, "upright": int(rng.choice([8, 16])), "bars": 32}[kind]
        gap = max(1, int(pitch * rng.uniform(0.2, 0.6)))
        marks = np.arange(side) % pitch < gap
        shade = light * rng.uniform(0.2, 0.8)
        if kind == "slats":
            image[marks] = shade
        else:
            image[:, marks] = shade
    return Texture(np.clip(image, 0.02, 0.98).astype(np.float32), size)


def writing(rng: Rng, width: float, height: float) -> Texture:
    """A white board: empty, or with lines of writing and drawings."""
    w, h = 256, 128
    image = rng.uniform(0.75, 0.9) + 0.02 * noise(
        rng, (h, w), (2.0, 1.0), finest=0.03, coarsest=0.6
    )
    for _ in range(int(rng.integers(0, 7))):
        x, y, wide = rng.integers(8, 160), rng.integers(8, 110), rng.integers(20, 90)
        ink = float(rng.uniform(0.05, 0.5))
        if rng.random() < 0.3:
            cv2.rectangle(image, (int(x), int(y)), (int(x + wide), int(y + 20)), ink, 1)
            continue
        t = np.arange(wide)
        heights = y + 2.5 * np.sin(t * rng.uniform(0.8, 1.6)) + rng.normal(0.0, 0.8, wide)
        rows = np.clip(np.rint(heights), 0, h - 1).astype(int)
        image[rows, np.minimum(x + t, w - 1)] = ink
    return Texture(np.clip(image, 0.02, 0.95).astype(np.float32), (width, height))


def fabric(rng: Rng, kind: str, mean: float, contrast: float = 1.0) -> Texture:
    """Cloth for people.

    Args:
        rng: Source of randomness.
        kind: plain, knit, stripes, checks, print, denim or blocks.
        mean: Mean reflectance; a dark pullover has 0.06.
        contrast: 1: as such cloth is.
    """
    size = (1.0, 1.0)
    shape = (256, 256)
    # Folds shade every garment: along the body, in proportion to its reflectance.
    folds = noise(rng, shape, size, finest=0.03, coarsest=0.25, slope=1.0, stretch=0.6)
    image = 0.09 * folds
    v, u = np.meshgrid(np.arange(256) / 256, np.arange(256) / 256, indexing="ij")
    if kind == "knit":
        image += 0.10 * noise(rng, shape, size, finest=0.012, coarsest=0.05, slope=0.3)
    elif kind == "denim":
        image += 0.12 * noise(rng, shape, size, finest=0.012, coarsest=0.12, slope=0.5)
    elif kind == "stripes":
        count = int(rng.integers(8, 22))
        image += 0.45 * np.sign(np.sin(2 * np.pi * count * (v if rng.random() < 0.7 else u)))
    elif kind == "checks":
        count = int(rng.integers(6, 16))
        image += 0.28 * np.sign(np.sin(2 * np.pi * count * u))
        image += 0.28 * np.sign(np.sin(2 * np.pi * count * v))
    elif kind == "blocks":
        bands = np.sin(2 * np.pi * int(rng.integers(1, 4)) * v + rng.uniform(0, 2 * np.pi))
        image += rng.uniform(0.3, 0.6) * np.sign(bands)
    elif kind == "print":
        blobs = noise(rng, shape, size, finest=0.03, coarsest=0.2, slope=0.8)
        image += 0.35 * np.clip(blobs, -1.5, 1.5)
    else:
        image += 0.03 * noise(rng, shape, size, finest=0.012, coarsest=0.05, slope=0.3)
    return Texture(_finish(mean * image, mean, contrast), size)


def skin(rng: Rng, mean: float) -> Texture:
    """Skin of arms and legs."""
    size = (0.5, 0.5)
    image = 0.05 * noise(rng, (128, 128), size, finest=0.01, coarsest=0.2, slope=1.0)
    return Texture(_finish(mean * image, mean, 1.0), size)


def head(rng: Rng, tone: float, hair: float, style: str, width: float, height: float) -> Texture:
    """A head unrolled: u once around it, the face in the middle of the tile, v from chin to crown.

    Args:
        rng: Source of randomness.
        tone: Reflectance of the skin.
        hair: Reflectance of the hair.
        style: short, long, bald or cap.
        width: Circumference [m].
        height: Length of the tile along v [m].
    """
    w, h = 128, 128
    image = np.full((h, w), tone, dtype=np.float32)
    u = (np.arange(w) - w / 2) / w * 2 * math.pi  # angle from the nose
    v = np.arange(h) / h  # 0 chin .. 1 crown
    uu, vv = np.meshgrid(u, v)
    image *= 1.0 - 0.15 * np.exp(-(((np.abs(uu) - 0.9) / 0.4) ** 2))  # cheeks turn away
    for side in (-1, 1):
        eye = np.exp(-(((uu - side * 0.42) / 0.16) ** 2) - ((vv - 0.52) / 0.035) ** 2)
        brow = np.exp(-(((uu - side * 0.42) / 0.24) ** 2) - ((vv - 0.60) / 0.025) ** 2)
        image += eye * (0.05 - tone) * 0.9 + brow * (hair - tone) * 0.8
    mouth = np.exp(-((uu / 0.3) ** 2) - ((vv - 0.2) / 0.03) ** 2)
    nose = np.exp(-(((np.abs(uu) - 0.10) / 0.08) ** 2) - ((vv - 0.34) / 0.03) ** 2)
    image -= (0.45 * mouth + 0.3 * nose) * tone
    if style != "bald":
        line = np.interp(np.abs(u), [0.0, 0.8, 1.2, 1.6, math.pi], [0.76, 0.72, 0.5, 0.3, 0.12])
        if style == "long":
            line = np.interp(np.abs(u), [0.0, 0.6, 0.95, math.pi], [0.76, 0.72, -0.1, -0.1])
        strands = 1 + 0.25 * noise(
            rng, (h, w), (width, height), finest=0.008, coarsest=0.08, slope=0.5, stretch=3.0
        )
        image = np.where(vv > line[None, :], hair * strands, image)
    image += 0.02 * tone * noise(rng, (h, w), (width, height), finest=0.01, coarsest=0.1)
    image = np.roll(image, w // 2, axis=1)  # a loft has u = 0 in front
    return Texture(np.clip(image, 0.02, 0.95).astype(np.float32), (width, height))
