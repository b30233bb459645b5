"""Images and depth of a procedural world by ray casting on one core: tiles, one ray a pixel, more where surfaces change."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from fecocodec.rendering.compilation import compiled
from fecocodec.training.textures import Textures
from fecocodec.training.world_intersect import meet, normal_and_chart
from fecocodec.training.world_shading import add_light, surface_colour, to_local, visibility_and_occlusion
from fecocodec.training.world_solids import NUM_ROOM_FACES, World

_TILE = 16
_NEAREST = 0.02
"""Metres in front of a camera within which nothing is seen."""


@dataclass(frozen=True)
class Pinholes:
    """Cameras of one size: positions and camera-to-world rotations in metres, focal length and centre in pixels."""

    eyes: Float[ndarray, "view 3"]
    rotations: Float[ndarray, "view 3 3"]
    focal: float
    centre: tuple[float, float]
    size: tuple[int, int]


def cast_images(
    world: World, textures: Textures, cameras: Pinholes
) -> tuple[Float[ndarray, "view height width 3"], Float[ndarray, "view height width"]]:
    """Linear light in [0, inf) and z-depth in metres at pixel centres."""
    solids = _solids(world)
    height, width = cameras.size
    images = np.empty((len(cameras.eyes), height, width, 3), dtype=np.float32)
    depth = np.empty((len(cameras.eyes), height, width), dtype=np.float32)
    surfaces = (world.surface_textures, world.surface_rows, textures.texels)
    room = np.stack((world.room_centre, world.room_half))
    for view, (eye, rotation) in enumerate(zip(cameras.eyes, cameras.rotations, strict=True)):
        optics = (np.ascontiguousarray(rotation), cameras.focal, *cameras.centre)
        _cast_view(solids, room, surfaces, world.lights.rows(), eye, optics, images[view], depth[view])
    return images, depth


def cast_depth(world: World, cameras: Pinholes) -> Float[ndarray, "view height width"]:
    """z-depth alone, in metres; for judging a camera path before rendering it."""
    solids = _solids(world)
    height, width = cameras.size
    depth = np.empty((len(cameras.eyes), height, width), dtype=np.float32)
    room = np.stack((world.room_centre, world.room_half))
    for view, (eye, rotation) in enumerate(zip(cameras.eyes, cameras.rotations, strict=True)):
        optics = (np.ascontiguousarray(rotation), cameras.focal, *cameras.centre)
        _cast_depth_view(solids, room, eye, optics, depth[view])
    return depth


def _solids(world: World) -> tuple[ndarray, ...]:
    frames = np.ascontiguousarray(world.rotations.transpose(0, 2, 1))
    return world.kinds, world.centres, world.halves, frames, world.radii


@compiled
def _cast_depth_view(solids, room, eye, optics, depth):
    candidates = np.arange(len(solids[0]))
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            ray = _ray(optics, column + 0.5, row + 0.5)
            depth[row, column] = _first_hit(solids, candidates, len(candidates), room, eye, ray)[0]


@compiled
def _cast_view(solids, room, surfaces, lights, eye, optics, image, depth):
    height, width = depth.shape
    faces = np.empty((height, width), np.int64)
    lists, counts = _solids_by_tile(solids, eye, optics, height, width)
    tiles_across = (width + _TILE - 1) // _TILE
    colour = np.empty(3)
    for row in range(height):
        for column in range(width):
            tile = (row // _TILE) * tiles_across + column // _TILE
            depth[row, column], faces[row, column] = _cast_ray(
                solids, lists[tile], counts[tile], room, surfaces, lights, eye, optics, column + 0.5, row + 0.5, colour
            )
            for channel in range(3):
                image[row, column, channel] = colour[channel]
    _smooth_edges(solids, lists, counts, room, surfaces, lights, eye, optics, faces, image)


@compiled
def _smooth_edges(solids, lists, counts, room, surfaces, lights, eye, optics, faces, image):
    """Four more rays (a turned square) through every pixel whose neighbour shows another face."""
    height, width = faces.shape
    tiles_across = (width + _TILE - 1) // _TILE
    colour = np.empty(3)
    for row in range(height):
        for column in range(width):
            face = faces[row, column]
            if (
                face == faces[max(row - 1, 0), column]
                and face == faces[min(row + 1, height - 1), column]
                and face == faces[row, max(column - 1, 0)]
                and face == faces[row, min(column + 1, width - 1)]
            ):
                continue
            tile = (row // _TILE) * tiles_across + column // _TILE
            image[row, column] = 0.0
            for corner in range(4):
                u = column + 0.5 + (-0.125, 0.375, 0.125, -0.375)[corner]
                v = row + 0.5 + (-0.375, -0.125, 0.375, 0.125)[corner]
                _cast_ray(solids, lists[tile], counts[tile], room, surfaces, lights, eye, optics, u, v, colour)
                for channel in range(3):
                    image[row, column, channel] += 0.25 * min(colour[channel], 4.0)


@compiled
def _ray(optics, u, v):
    """World direction through an image position in pixels, scaled to one unit along the optical axis."""
    rotation, focal, centre_u, centre_v = optics
    x, y = (u - centre_u) / focal, (v - centre_v) / focal
    return (
        rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2],
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2],
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2],
    )


@compiled
def _first_hit(solids, candidates, num_candidates, room, eye, ray):
    """(depth, solid) of the nearest surface; solid -1 is the room."""
    kinds, centres, halves, frames, _ = solids
    nearest = 1e30
    for axis in range(3):
        direction = ray[axis]
        if abs(direction) > 1e-12:
            wall = room[0, axis] + math.copysign(room[1, axis], direction)
            nearest = min(nearest, (wall - eye[axis]) / direction)
    hit = -1
    for index in range(num_candidates):
        solid = candidates[index]
        x, y, z = eye[0] - centres[solid, 0], eye[1] - centres[solid, 1], eye[2] - centres[solid, 2]
        ox, oy, oz = to_local(frames, halves, solid, x, y, z)
        dx, dy, dz = to_local(frames, halves, solid, ray[0], ray[1], ray[2])
        start, end = meet(kinds[solid], ox, oy, oz, dx, dy, dz)
        if start < end and _NEAREST < start < nearest:
            nearest, hit = start, solid
    return nearest, hit


@compiled
def _cast_ray(solids, candidates, num_candidates, room, surfaces, lights, eye, optics, u, v, colour):
    """Colour (written in place) through an image position; returns depth and the number of the face that was hit."""
    ray = _ray(optics, u, v)
    depth, solid = _first_hit(solids, candidates, num_candidates, room, eye, ray)
    point = (eye[0] + ray[0] * depth, eye[1] + ray[1] * depth, eye[2] + ray[2] * depth)
    normal, chart_u, chart_v, face, surface = _surface_at(solids, room, point, solid)
    length = math.sqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2])
    view = (ray[0] / length, ray[1] / length, ray[2] / length)
    slant = max(abs(view[0] * normal[0] + view[1] * normal[1] + view[2] * normal[2]), 0.04)
    footprint = depth * length / optics[1] / math.sqrt(slant)
    texture_of, rows, texels = surfaces
    row = rows[surface]
    surface_colour(texels, texture_of[surface], row, chart_u, chart_v, footprint, colour)
    if row[13] < 1.0:
        visible, open_share = visibility_and_occlusion(solids, point, normal, lights[0], solid, lights[5, 0])
        add_light(row, lights, point, normal, view, visible, open_share * _corner_share(room, point), colour)
    return depth, face


@compiled
def _surface_at(solids, room, point, solid):
    """(unit normal, texture position in metres (2), number of the face, number of the surface)"""
    kinds, centres, halves, frames, _ = solids
    if solid < 0:
        x, y, z = point[0] - room[0, 0], point[1] - room[0, 1], point[2] - room[0, 2]
        hx, hy, hz = room[1, 0], room[1, 1], room[1, 2]
        nx, ny, nz, chart_u, chart_v, face = normal_and_chart(0, x / hx, y / hy, z / hz, hx, hy, hz)
        return (-nx, -ny, -nz), chart_u, chart_v, face, face
    x, y, z = point[0] - centres[solid, 0], point[1] - centres[solid, 1], point[2] - centres[solid, 2]
    x, y, z = to_local(frames, halves, solid, x, y, z)
    hx, hy, hz = halves[solid, 0], halves[solid, 1], halves[solid, 2]
    nx, ny, nz, chart_u, chart_v, face = normal_and_chart(kinds[solid], x, y, z, hx, hy, hz)
    nx, ny, nz = nx / hx, ny / hy, nz / hz
    frame = frames[solid]
    wx = frame[0, 0] * nx + frame[1, 0] * ny + frame[2, 0] * nz
    wy = frame[0, 1] * nx + frame[1, 1] * ny + frame[2, 1] * nz
    wz = frame[0, 2] * nx + frame[1, 2] * ny + frame[2, 2] * nz
    length = math.sqrt(wx * wx + wy * wy + wz * wz)
    normal = (wx / length, wy / length, wz / length)
    return normal, chart_u, chart_v, 8 * (solid + 1) + face, NUM_ROOM_FACES + solid


@compiled
def _corner_share(room, point):
    """Darkening towards the edges of the room, where less of the surroundings is open."""
    share = 1.0
    for axis in range(3):
        gap = room[1, axis] - abs(point[axis] - room[0, axis])
        if gap > 1e-4 * room[1, axis]:
            share *= 1.0 - 0.35 * math.exp(-3.0 * gap)
    return share


@compiled
def _solids_by_tile(solids, eye, optics, height, width):
    """For every tile the solids that may show in it, from the image bounds of their boxes."""
    rows, columns = (height + _TILE - 1) // _TILE, (width + _TILE - 1) // _TILE
    lists = np.empty((rows * columns, max(len(solids[0]), 1)), np.int64)
    counts = np.zeros(rows * columns, np.int64)
    for solid in range(len(solids[0])):
        left, top, right, bottom = _image_bounds(solids, solid, eye, optics, height, width)
        for row in range(max(int(top // _TILE), 0), min(int(bottom // _TILE) + 1, rows)):
            for column in range(max(int(left // _TILE), 0), min(int(right // _TILE) + 1, columns)):
                tile = row * columns + column
                lists[tile, counts[tile]] = solid
                counts[tile] += 1
    return lists, counts


@compiled
def _image_bounds(solids, solid, eye, optics, height, width):
    """(left, top, right, bottom) in pixels; empty when behind the camera, all of the image when it reaches behind."""
    _, centres, halves, frames, _ = solids
    rotation, focal, centre_u, centre_v = optics
    frame = frames[solid]
    left, top, right, bottom = 1e9, 1e9, -1e9, -1e9
    num_behind = 0
    for corner in range(8):
        sx = halves[solid, 0] * (1.0 if corner & 1 else -1.0)
        sy = halves[solid, 1] * (1.0 if corner & 2 else -1.0)
        sz = halves[solid, 2] * (1.0 if corner & 4 else -1.0)
        wx = centres[solid, 0] - eye[0] + frame[0, 0] * sx + frame[1, 0] * sy + frame[2, 0] * sz
        wy = centres[solid, 1] - eye[1] + frame[0, 1] * sx + frame[1, 1] * sy + frame[2, 1] * sz
        wz = centres[solid, 2] - eye[2] + frame[0, 2] * sx + frame[1, 2] * sy + frame[2, 2] * sz
        z = rotation[0, 2] * wx + rotation[1, 2] * wy + rotation[2, 2] * wz
        if z < _NEAREST:
            num_behind += 1
            continue
        u = centre_u + focal * (rotation[0, 0] * wx + rotation[1, 0] * wy + rotation[2, 0] * wz) / z
        v = centre_v + focal * (rotation[0, 1] * wx + rotation[1, 1] * wy + rotation[2, 1] * wz) / z
        left, right = min(left, u), max(right, u)
        top, bottom = min(top, v), max(bottom, v)
    if 0 < num_behind < 8:
        return 0.0, 0.0, width - 1.0, height - 1.0
    # int() of a bound far outside would overflow, and nothing outside the image matters.
    return max(left, -1e6), max(top, -1e6), min(right, 1e6), min(bottom, 1e6)
