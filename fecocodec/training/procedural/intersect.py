# mypy: disallow-untyped-defs=False
"""Intersection of rays with convex solids in unit coordinates; each solid gives one interval of the ray."""

import math

from fecocodec.kernels.compilation import compiled
from fecocodec.training.procedural.solids import BOX, CYLINDER, ELLIPSOID

MISS = 1e30
"""Start of the interval of a ray that misses; its end is smaller."""


@compiled
def slab(origin, direction):
    """Return the interval in which one coordinate is in [-1, 1]."""
    if abs(direction) < 1e-12:
        direction = 1e-12
    first = (-1.0 - origin) / direction
    second = (1.0 - origin) / direction
    return min(first, second), max(first, second)


@compiled
def intersect(kind, ox, oy, oz, dx, dy, dz):
    """Return (start, end) of the ray inside the solid, in units of the direction; start > end if it misses."""
    if kind == BOX:
        start_x, end_x = slab(ox, dx)
        start_y, end_y = slab(oy, dy)
        start_z, end_z = slab(oz, dz)
        return max(start_x, start_y, start_z), min(end_x, end_y, end_z)
    if kind == ELLIPSOID:
        return _intersect_sphere(ox, oy, oz, dx, dy, dz)
    if kind == CYLINDER:
        return _intersect_cylinder(ox, oy, oz, dx, dy, dz)
    return _intersect_cone(ox, oy, oz, dx, dy, dz)


@compiled
def _intersect_sphere(ox, oy, oz, dx, dy, dz):
    a = dx * dx + dy * dy + dz * dz
    b = ox * dx + oy * dy + oz * dz
    c = ox * ox + oy * oy + oz * oz - 1.0
    discriminant = b * b - a * c
    if discriminant <= 0.0:
        return MISS, -MISS
    root = math.sqrt(discriminant)
    return (-b - root) / a, (-b + root) / a


@compiled
def _intersect_cylinder(ox, oy, oz, dx, dy, dz):
    a = dx * dx + dz * dz + 1e-18
    b = ox * dx + oz * dz
    c = ox * ox + oz * oz - 1.0
    discriminant = b * b - a * c
    if discriminant <= 0.0:
        return MISS, -MISS
    root = math.sqrt(discriminant)
    start, end = slab(oy, dy)
    return max(start, (-b - root) / a), min(end, (-b + root) / a)


@compiled
def _intersect_cone(ox, oy, oz, dx, dy, dz):
    """Apex at y = -1, base of radius 1 at y = 1: x^2 + z^2 <= ((y + 1) / 2)^2."""
    height = oy + 1.0
    a = dx * dx + dz * dz - 0.25 * dy * dy
    b = ox * dx + oz * dz - 0.25 * height * dy
    c = ox * ox + oz * oz - 0.25 * height * height
    if abs(a) < 1e-12:
        a = 1e-12
    discriminant = b * b - a * c
    start, end = slab(oy, dy)
    if discriminant <= 0.0:
        return (start, end) if a < 0.0 else (MISS, -MISS)
    root = math.sqrt(discriminant)
    first = (-b - root) / a
    second = (-b + root) / a
    if a > 0.0:
        return max(start, first), min(end, second)
    # A ray steeper than the cone is inside beyond its larger root or before its smaller one: take the half with y > -1.
    if dy > 0.0:
        return max(start, max(first, second)), end
    return start, min(end, min(first, second))


@compiled
def normal_and_chart(kind, x, y, z, hx, hy, hz):
    """Return, at a surface point in unit coordinates, the outward normal (3, unit coordinates, any length), the texture
    position in metres (2) and the index of the smooth face."""
    radial = math.sqrt(x * x + z * z)
    if kind == BOX:
        return _box_chart(x, y, z, hx, hy, hz)
    if kind == ELLIPSOID:
        return x, y, z, math.atan2(x, z) * max(hx, hz), y * hy, 0
    if kind == CYLINDER:
        if abs(y) > radial:
            return 0.0, math.copysign(1.0, y), 0.0, x * hx, z * hz, 1
        return x, 0.0, z, math.atan2(x, z) * max(hx, hz), y * hy, 0
    if abs(1.0 - y) < abs(0.5 * (y + 1.0) - radial):
        return 0.0, 1.0, 0.0, x * hx, z * hz, 1
    return x, -0.25 * (y + 1.0), z, math.atan2(x, z) * max(hx, hz), y * hy, 0


@compiled
def _box_chart(x, y, z, hx, hy, hz):
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        return math.copysign(1.0, x), 0.0, 0.0, z * hz, y * hy, 0 if x < 0.0 else 1
    if ay >= az:
        return 0.0, math.copysign(1.0, y), 0.0, x * hx, z * hz, 2 if y < 0.0 else 3
    return 0.0, 0.0, math.copysign(1.0, z), x * hx, y * hy, 4 if z < 0.0 else 5
