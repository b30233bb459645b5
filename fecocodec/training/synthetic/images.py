# mypy: disallow-untyped-defs=False
"""Ray-cast images and depth of a synthetic world, on one core: one ray per pixel, four at edges."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from fecocodec.kernels.compilation import compiled
from fecocodec.training.synthetic.raycast import OPTICS, TILE, first_hit, ray_through, solids_by_tile, surface_at
from fecocodec.training.synthetic.shading import lit, surface_colour, visibility_and_openness
from fecocodec.training.synthetic.solids import GLOW, World, light_table, solid_table, surface_table
from fecocodec.training.synthetic.textures import Textures

_BRIGHTEST = 4.0
"""Light is clamped to this where edges are smoothed; otherwise edges of lamps would stay jagged."""


@dataclass(frozen=True)
class Pinholes:
    """Pinhole cameras of one image size. World frame: metres, y down.

    eyes: positions. rotations: camera-to-world. focal, centre (u, v): in pixels. size: (height, width) in pixels.
    """

    eyes: Float[ndarray, "view 3"]
    rotations: Float[ndarray, "view 3 3"]
    focal: float
    centre: tuple[float, float]
    size: tuple[int, int]

    def tables(self) -> Float[ndarray, "view 5 3"]:
        """Return the table of each camera in the layout of `raycast`."""
        optics = np.broadcast_to([self.focal, *self.centre], (len(self.eyes), 1, 3))
        return np.concatenate((self.rotations, self.eyes[:, None], optics), axis=1)


def cast_images(
    world: World, textures: Textures, cameras: Pinholes
) -> tuple[Float[ndarray, "view height width 3"], Float[ndarray, "view height width"]]:
    """Return linear light, at least 0, and z-depth in metres at pixel centres."""
    height, width = cameras.size
    images = np.empty((len(cameras.eyes), height, width, 3), dtype=np.float32)
    depth = np.empty((len(cameras.eyes), height, width), dtype=np.float32)
    room = np.stack((world.room_centre, world.room_half))
    solids, surfaces, lights = solid_table(world), surface_table(world.surfaces), light_table(world.lights)
    for view, camera in enumerate(cameras.tables()):
        _cast_view(solids, room, surfaces, textures.texels, lights, camera, images[view], depth[view])
    return images, depth


def cast_depth(world: World, cameras: Pinholes) -> Float[ndarray, "view height width"]:
    """Return z-depth alone, in metres, for checks of a camera path."""
    height, width = cameras.size
    depth = np.empty((len(cameras.eyes), height, width), dtype=np.float32)
    room, solids = np.stack((world.room_centre, world.room_half)), solid_table(world)
    for view, camera in enumerate(cameras.tables()):
        _cast_depth_view(solids, room, camera, depth[view])
    return depth


@compiled
def _cast_depth_view(solids, room, camera, depth):
    candidates = np.arange(len(solids))
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            ray = ray_through(camera, column + 0.5, row + 0.5)
            depth[row, column] = first_hit(solids, candidates, 0, len(solids), room, camera, ray)[0]


@compiled
def _cast_view(solids, room, surfaces, texels, lights, camera, image, depth):
    """Write the image and the depth of one view."""
    height, width = depth.shape
    faces = np.empty((height, width), np.int64)
    lists, starts = solids_by_tile(solids, camera, height, width)
    tiles_across = (width + TILE - 1) // TILE
    for row in range(height):
        for column in range(width):
            tile = (row // TILE) * tiles_across + column // TILE
            begin, end = starts[tile], starts[tile + 1]
            u, v = column + 0.5, row + 0.5
            red, green, blue, depth[row, column], faces[row, column] = _cast_ray(
                solids, lists, begin, end, room, surfaces, texels, lights, camera, u, v
            )
            image[row, column, 0], image[row, column, 1], image[row, column, 2] = red, green, blue
    _smooth_edges(solids, lists, starts, room, surfaces, texels, lights, camera, faces, image)


@compiled
def _smooth_edges(solids, lists, starts, room, surfaces, texels, lights, camera, faces, image):
    """Recompute every pixel whose neighbour shows another face from four rays in a rotated square."""
    height, width = faces.shape
    tiles_across = (width + TILE - 1) // TILE
    for row in range(height):
        for column in range(width):
            if not _is_edge(faces, row, column):
                continue
            tile = (row // TILE) * tiles_across + column // TILE
            begin, end = starts[tile], starts[tile + 1]
            for channel in range(3):
                image[row, column, channel] = 0.0
            for corner in range(4):
                u = column + (0.375, 0.875, 0.625, 0.125)[corner]
                v = row + (0.125, 0.375, 0.875, 0.625)[corner]
                light = _cast_ray(solids, lists, begin, end, room, surfaces, texels, lights, camera, u, v)
                image[row, column, 0] += 0.25 * min(light[0], _BRIGHTEST)
                image[row, column, 1] += 0.25 * min(light[1], _BRIGHTEST)
                image[row, column, 2] += 0.25 * min(light[2], _BRIGHTEST)


@compiled
def _is_edge(faces, row, column):
    height, width = faces.shape
    face = faces[row, column]
    return (
        face != faces[max(row - 1, 0), column]
        or face != faces[min(row + 1, height - 1), column]
        or face != faces[row, max(column - 1, 0)]
        or face != faces[row, min(column + 1, width - 1)]
    )


@compiled
def _cast_ray(solids, lists, begin, end, room, surfaces, texels, lights, camera, u, v):
    """Return (red, green, blue, depth, face index) at an image position."""
    ray = ray_through(camera, u, v)
    depth, solid = first_hit(solids, lists, begin, end, room, camera, ray)
    point = (camera[3, 0] + ray[0] * depth, camera[3, 1] + ray[1] * depth, camera[3, 2] + ray[2] * depth)
    normal, chart_u, chart_v, face, surface = surface_at(solids, room, point, solid)
    length = math.sqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2])
    view = (ray[0] / length, ray[1] / length, ray[2] / length)
    # The footprint of a pixel on a slanted surface is longer along the slant; the mip level uses the geometric mean.
    slant = max(abs(view[0] * normal[0] + view[1] * normal[1] + view[2] * normal[2]), 0.04)
    footprint = depth * length / camera[OPTICS, 0] / math.sqrt(slant)
    colour = surface_colour(texels, surfaces, surface, chart_u, chart_v, footprint)
    if surfaces[surface, GLOW] < 1.0:
        visible, openness = visibility_and_openness(solids, solid, point, normal, lights)
        openness *= _openness_of_corner(room, point)
        colour = lit(surfaces, surface, colour, lights, point, normal, view, visible, openness)
    return colour[0], colour[1], colour[2], depth, face


@compiled
def _openness_of_corner(room, point):
    """Return the ambient occlusion near the edges of the room."""
    openness = 1.0
    for axis in range(3):
        gap = room[1, axis] - abs(point[axis] - room[0, axis])
        if gap > 1e-4 * room[1, axis]:
            openness *= 1.0 - 0.35 * math.exp(-3.0 * gap)
    return openness
