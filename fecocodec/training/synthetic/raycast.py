# mypy: disallow-untyped-defs=False
"""Nearest surface along the rays of a camera, its normal and its texture position.

A ray meets a convex solid, in the unit coordinates of the solid, in one interval. A camera is a table of 5 x 3 numbers:
the camera-to-world rotation by rows, the position, and (focal length, centre u, centre v) in pixels. Solids are the
table of `solid_table`; a room is its centre and half size.
"""

import math

import numpy as np

from fecocodec.kernels.compilation import compiled
from fecocodec.training.synthetic.solids import BOX, CENTRE, CYLINDER, ELLIPSOID, FRAME, HALF, KIND, NUM_ROOM_FACES

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
def to_unit(solids, solid, x, y, z):
    """Transform a world vector to the unit coordinates of a solid."""
    return (
        solids[solid, FRAME] * x + solids[solid, FRAME + 1] * y + solids[solid, FRAME + 2] * z,
        solids[solid, FRAME + 3] * x + solids[solid, FRAME + 4] * y + solids[solid, FRAME + 5] * z,
        solids[solid, FRAME + 6] * x + solids[solid, FRAME + 7] * y + solids[solid, FRAME + 8] * z,
    )


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


EYE, OPTICS = 3, 4
TILE = 16
_NEAREST = 0.02
"""Near clipping distance in metres."""
_FACES_PER_SOLID = 8


@compiled
def ray_through(camera, u, v):
    """Return the world direction through an image position in pixels, with length 1 along the optical axis."""
    x, y = (u - camera[OPTICS, 1]) / camera[OPTICS, 0], (v - camera[OPTICS, 2]) / camera[OPTICS, 0]
    return (
        camera[0, 0] * x + camera[0, 1] * y + camera[0, 2],
        camera[1, 0] * x + camera[1, 1] * y + camera[1, 2],
        camera[2, 0] * x + camera[2, 1] * y + camera[2, 2],
    )


@compiled
def first_hit(solids, candidates, begin, end, room, camera, ray):
    """Return (depth, solid) of the nearest surface of candidates[begin:end] and the room; solid -1 is the room."""
    nearest = 1e30
    for axis in range(3):
        direction = ray[axis]
        if abs(direction) > 1e-12:
            wall = room[0, axis] + math.copysign(room[1, axis], direction)
            nearest = min(nearest, (wall - camera[EYE, axis]) / direction)
    hit = -1
    for index in range(begin, end):
        solid = candidates[index]
        x, y, z = _from_centre(solids, solid, camera[EYE, 0], camera[EYE, 1], camera[EYE, 2])
        ox, oy, oz = to_unit(solids, solid, x, y, z)
        dx, dy, dz = to_unit(solids, solid, ray[0], ray[1], ray[2])
        enter, leave = intersect(solids[solid, KIND], ox, oy, oz, dx, dy, dz)
        if enter < leave and _NEAREST < enter < nearest:
            nearest, hit = enter, solid
    return nearest, hit


@compiled
def surface_at(solids, room, point, solid):
    """Return (unit normal, texture position in metres (2), index of the smooth face, index of the surface)."""
    if solid < 0:
        x, y, z = point[0] - room[0, 0], point[1] - room[0, 1], point[2] - room[0, 2]
        hx, hy, hz = room[1, 0], room[1, 1], room[1, 2]
        nx, ny, nz, chart_u, chart_v, face = normal_and_chart(BOX, x / hx, y / hy, z / hz, hx, hy, hz)
        return (-nx, -ny, -nz), chart_u, chart_v, face, face
    x, y, z = _from_centre(solids, solid, point[0], point[1], point[2])
    x, y, z = to_unit(solids, solid, x, y, z)
    hx, hy, hz = solids[solid, HALF], solids[solid, HALF + 1], solids[solid, HALF + 2]
    nx, ny, nz, chart_u, chart_v, face = normal_and_chart(solids[solid, KIND], x, y, z, hx, hy, hz)
    # Normals transform by the inverse transpose of unit-to-world, the transpose of the stored matrix.
    wx = solids[solid, FRAME] * nx + solids[solid, FRAME + 3] * ny + solids[solid, FRAME + 6] * nz
    wy = solids[solid, FRAME + 1] * nx + solids[solid, FRAME + 4] * ny + solids[solid, FRAME + 7] * nz
    wz = solids[solid, FRAME + 2] * nx + solids[solid, FRAME + 5] * ny + solids[solid, FRAME + 8] * nz
    length = math.sqrt(wx * wx + wy * wy + wz * wz)
    face += _FACES_PER_SOLID * (solid + 1)
    return (wx / length, wy / length, wz / length), chart_u, chart_v, face, NUM_ROOM_FACES + solid


@compiled
def _from_centre(solids, solid, x, y, z):
    return x - solids[solid, CENTRE], y - solids[solid, CENTRE + 1], z - solids[solid, CENTRE + 2]


@compiled
def solids_by_tile(solids, camera, height, width):
    """Return (solids, starts): solids that may cover tile t (row by row) are solids[starts[t] : starts[t + 1]]."""
    rows, columns = (height + TILE - 1) // TILE, (width + TILE - 1) // TILE
    lists = np.empty(rows * columns * len(solids), np.int64)
    starts = np.zeros(rows * columns + 1, np.int64)
    bounds = np.empty((len(solids), 4))
    for solid in range(len(solids)):
        bounds[solid] = _image_bounds(solids, solid, camera, height, width)
    count = 0
    for tile in range(rows * columns):
        top, left = tile // columns * TILE, tile % columns * TILE
        for solid in range(len(solids)):
            is_across = bounds[solid, 0] < left + TILE and bounds[solid, 2] > left
            if is_across and bounds[solid, 1] < top + TILE and bounds[solid, 3] > top:
                lists[count] = solid
                count += 1
        starts[tile + 1] = count
    return lists, starts


@compiled
def _image_bounds(solids, solid, camera, height, width):
    """Return (left, top, right, bottom) of a solid in pixels; the whole image if it extends behind the camera."""
    left, top, right, bottom = 1e9, 1e9, -1e9, -1e9
    cx, cy, cz = _from_centre(solids, solid, camera[EYE, 0], camera[EYE, 1], camera[EYE, 2])
    num_behind = 0
    for corner in range(8):
        # Rows of the matrix are axes over half sizes, so an axis times its half size is row * half^2.
        wx, wy, wz = -cx, -cy, -cz
        for axis in range(3):
            half = solids[solid, HALF + axis]
            reach = half * half * (1.0 if (corner >> axis) & 1 else -1.0)
            wx += solids[solid, FRAME + 3 * axis] * reach
            wy += solids[solid, FRAME + 3 * axis + 1] * reach
            wz += solids[solid, FRAME + 3 * axis + 2] * reach
        z = camera[0, 2] * wx + camera[1, 2] * wy + camera[2, 2] * wz
        if z < _NEAREST:
            num_behind += 1
            continue
        u = camera[OPTICS, 1] + camera[OPTICS, 0] * (camera[0, 0] * wx + camera[1, 0] * wy + camera[2, 0] * wz) / z
        v = camera[OPTICS, 2] + camera[OPTICS, 0] * (camera[0, 1] * wx + camera[1, 1] * wy + camera[2, 1] * wz) / z
        left, right, top, bottom = min(left, u), max(right, u), min(top, v), max(bottom, v)
    if 0 < num_behind < 8:
        return 0.0, 0.0, float(width), float(height)
    return left, top, right, bottom
