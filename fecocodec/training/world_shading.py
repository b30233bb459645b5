"""The colour of a surface point, compiled: filtered texture, shadow, ambient occlusion, diffuse light and highlight."""

import math

from fecocodec.rendering.compilation import compiled
from fecocodec.training.textures import TEXTURE_SIDE
from fecocodec.training.world_intersect import meet

_NUM_LEVELS = TEXTURE_SIDE.bit_length()
_OCCLUSION_REACH = 0.02
"""Solids that fill less of the sky than this do not darken a point."""


@compiled
def to_local(frames, halves, solid, x, y, z):
    """Turn and scale a world vector into unit coordinates of a solid (frames: world-to-local rotations)."""
    frame = frames[solid]
    return (
        (frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z) / halves[solid, 0],
        (frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z) / halves[solid, 1],
        (frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z) / halves[solid, 2],
    )


@compiled
def _texel(texels, texture, level, u, v, channel_sums, share):
    """Add share times the bilinear, tiling texture value (linear light, gamma 2) at one level to the sums."""
    side = TEXTURE_SIDE >> level
    start = (4 * (TEXTURE_SIDE * TEXTURE_SIDE - side * side)) // 3
    x = (u - math.floor(u)) * side - 0.5
    y = (v - math.floor(v)) * side - 0.5
    left, top = int(math.floor(x)), int(math.floor(y))
    across, down = x - left, y - top
    mask = side - 1
    for corner in range(4):
        right, below = corner & 1, corner >> 1
        weight = share * (across if right else 1.0 - across) * (down if below else 1.0 - down)
        texel = texels[texture, start + ((top + below) & mask) * side + ((left + right) & mask)]
        for channel in range(3):
            value = texel[channel] * (1.0 / 255.0)
            channel_sums[channel] += weight * value * value


@compiled
def surface_colour(texels, texture, row, chart_u, chart_v, footprint, colour):
    """Colour without light. footprint: metres on the surface that one pixel covers."""
    share = row[4]
    colour[0] = colour[1] = colour[2] = 0.0
    if share > 0.0:
        u = chart_u * row[0] + row[2]
        v = chart_v * row[1] + row[3]
        covered = footprint * math.sqrt(abs(row[0] * row[1])) * TEXTURE_SIDE
        level = min(max(math.log2(max(covered, 1e-6)), 0.0), _NUM_LEVELS - 1.001)
        fine = int(level)
        _texel(texels, texture, fine, u, v, colour, 1.0 - (level - fine))
        _texel(texels, texture, fine + 1, u, v, colour, level - fine)
    for channel in range(3):
        colour[channel] = share * colour[channel] * row[5 + channel] + (1.0 - share) * row[8 + channel]


@compiled
def visibility_and_occlusion(solids, point, normal, light, skipped, softness):
    """(share of the key light that arrives, share of the surroundings that solids leave open).

    A shadow deepens with the length of the ray's chord in the solid, relative to the distance: exact where it is
    full, soft at the edge. Ambient occlusion adds up the bounding spheres (Quilez, "sphere ambient occlusion").
    """
    kinds, centres, halves, frames, radii = solids
    lx, ly, lz = light[0] - point[0], light[1] - point[1], light[2] - point[2]
    distance = math.sqrt(lx * lx + ly * ly + lz * lz)
    lx, ly, lz = lx / distance, ly / distance, lz / distance
    is_lit = lx * normal[0] + ly * normal[1] + lz * normal[2] > 0.0
    visible, occluded = 1.0, 0.0
    for solid in range(len(kinds)):
        cx, cy, cz = centres[solid, 0] - point[0], centres[solid, 1] - point[1], centres[solid, 2] - point[2]
        squared = cx * cx + cy * cy + cz * cz
        radius = radii[solid]
        if solid != skipped and radius * radius > _OCCLUSION_REACH * squared:
            facing = cx * normal[0] + cy * normal[1] + cz * normal[2]
            if facing > 0.0:
                size = halves[solid, 0] * halves[solid, 1] * halves[solid, 2]
                occluded += facing * math.pow(size, 2.0 / 3.0) / (squared * math.sqrt(squared) + 1e-9)
        if not is_lit or visible <= 0.0:
            continue
        along = cx * lx + cy * ly + cz * lz
        if along < -radius or squared - along * along > radius * radius:
            continue
        ox, oy, oz = to_local(frames, halves, solid, -cx, -cy, -cz)
        dx, dy, dz = to_local(frames, halves, solid, lx, ly, lz)
        start, end = meet(kinds[solid], ox, oy, oz, dx, dy, dz)
        start, end = max(start, 1e-3 * (1.0 + radius)), min(end, distance)
        if end > start:
            visible -= (end - start) / (softness * start + 1e-3 * radius)
    return (max(visible, 0.0) if is_lit else 0.0), 1.0 - min(occluded, 0.75)


@compiled
def add_light(row, lights, point, normal, view, visible, open_share, colour):
    """Turn the surface colour into light towards the viewer, in place: Lambert, and Blinn-Phong for the highlight."""
    key = lambert(lights[0], point, normal) * visible
    fill = lambert(lights[2], point, normal) * open_share
    highlight = row[11] * key * _highlight(lights[0], point, normal, view, row[12]) if row[11] > 0.0 else 0.0
    for channel in range(3):
        light = lights[4, channel] * open_share + key * lights[1, channel] + fill * lights[3, channel]
        light = row[13] + (1.0 - row[13]) * light
        colour[channel] = colour[channel] * light + highlight * lights[1, channel]


@compiled
def lambert(light, point, normal):
    """Cosine between the normal and the direction to a light, at least 0."""
    x, y, z = light[0] - point[0], light[1] - point[1], light[2] - point[2]
    cosine = (x * normal[0] + y * normal[1] + z * normal[2]) / math.sqrt(x * x + y * y + z * z)
    return max(cosine, 0.0)


@compiled
def _highlight(light, point, normal, view, shininess):
    x, y, z = light[0] - point[0], light[1] - point[1], light[2] - point[2]
    length = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / length - view[0], y / length - view[1], z / length - view[2]
    cosine = (x * normal[0] + y * normal[1] + z * normal[2]) / math.sqrt(x * x + y * y + z * z + 1e-12)
    return math.pow(max(cosine, 0.0), shininess)
